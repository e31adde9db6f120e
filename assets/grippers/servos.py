"""Servos of grippers: an opening that follows a rate, and a vacuum that is switched."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.base import Gripper

OPENING_SPEED_M_S = 0.17
"""Speed of the opening at full rate: the jaw's whole stroke takes half a second."""
SQUEEZE_M = 0.003
"""A jaw commanded this much narrower than it is gets its full force."""


class OpeningServo:
    """Moves a gripper's opening at `rate` times `OPENING_SPEED_M_S`, and squeezes with full force what stops it."""

    def __init__(
        self,
        opening_m: Float[np.ndarray, "1"],
        control: Float[np.ndarray, "1"],
        max_opening_m: float,
        full_force_control: float,
    ) -> None:
        """Start from a gripper that is fully open.

        `opening_m` and `control` are MuJoCo's own memory: the present opening, and the control that commands one.
        """
        self._measured_m, self._control = opening_m, control
        self._max_opening_m, self._full_force_control = max_opening_m, full_force_control
        self._opening_m = max_opening_m

    def command(self, rate: float, period_s: float) -> None:
        """Set the controls for one period; see `GripperServo`."""
        # The command never runs far ahead of a blocked jaw, so that it opens without delay.
        full_force_m = self._measured_m.item() - SQUEEZE_M
        wanted_m = self._opening_m - rate * OPENING_SPEED_M_S * period_s
        self._opening_m = min(max(wanted_m, full_force_m), self._max_opening_m)
        squeeze = self._opening_m <= full_force_m
        self._control[0] = self._full_force_control if squeeze else max(self._opening_m, 0.0)


class SwitchServo:
    """Switches a gripper on or off by the sign of the rate; while on, it grips whatever it can at any time."""

    def __init__(self, gripper: Gripper, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Start from a gripper that is off."""
        self._gripper, self._model, self._data = gripper, model, data
        self._on = False

    def command(self, rate: float, period_s: float) -> None:
        """Set the controls for one period; see `GripperServo`."""
        self._on = rate > 0 or (self._on and rate == 0)
        if self._on:
            self._gripper.grip(self._model, self._data)
        else:
            self._gripper.release(self._model, self._data, 0.0)
