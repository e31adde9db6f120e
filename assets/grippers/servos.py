"""Servos of grippers: an opening that follows a rate, and a vacuum that is switched."""

from __future__ import annotations

import mujoco

from simpick.assets.grippers.base import Gripper

OPENING_SPEED_M_S = 0.17
"""Speed of the opening at full rate: the jaw's whole stroke takes half a second."""
SQUEEZE_M = 0.003
"""A jaw commanded this much narrower than it is gets its full force."""


class OpeningServo:
    """Moves a gripper's opening at `rate` times `OPENING_SPEED_M_S`, and squeezes with full force what stops it."""

    def __init__(self, gripper: Gripper) -> None:
        """Start from a gripper that is fully open."""
        self._gripper = gripper
        self._opening_m = gripper.max_opening_m

    def command(self, model: mujoco.MjModel, data: mujoco.MjData, rate: float, period_s: float) -> None:
        """Set the controls for one period; see `GripperServo`."""
        # The command never runs far ahead of a blocked jaw, so that it opens without delay.
        full_force_m = self._gripper.opening_m(model, data) - SQUEEZE_M
        wanted_m = self._opening_m - rate * OPENING_SPEED_M_S * period_s
        self._opening_m = min(max(wanted_m, full_force_m), self._gripper.max_opening_m)
        if self._opening_m <= full_force_m:
            self._gripper.grip(model, data)
        else:
            self._gripper.release(model, data, self._opening_m)


class SwitchServo:
    """Switches a gripper on or off by the sign of the rate; while on, it grips whatever it can at any time."""

    def __init__(self, gripper: Gripper) -> None:
        """Start from a gripper that is off."""
        self._gripper = gripper
        self._on = False

    def command(self, model: mujoco.MjModel, data: mujoco.MjData, rate: float, period_s: float) -> None:
        """Set the controls for one period; see `GripperServo`."""
        self._on = rate > 0 or (self._on and rate == 0)
        if self._on:
            self._gripper.grip(model, data)
        else:
            self._gripper.release(model, data, 0.0)
