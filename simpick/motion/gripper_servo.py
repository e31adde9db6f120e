"""`GripperServo`: opens, closes and holds a gripper by a commanded rate, as a teleoperator's trigger does."""

from __future__ import annotations

import mujoco
import numpy as np

from simpick.assets.grippers import Gripper

JAW_SPEED_M_S = 0.17
"""Speed of the opening at full rate: the whole stroke takes half a second."""
SQUEEZE_M = 0.003
"""A jaw commanded this much narrower than it is gets its full force."""


class GripperServo:
    """Commands one gripper; a rate of zero keeps what it does."""

    def __init__(self, gripper: Gripper) -> None:
        """Start from a gripper that is fully open, or without vacuum."""
        self._gripper = gripper
        self._opening_m = gripper.max_opening_m
        self._vacuum = False

    def command(self, model: mujoco.MjModel, data: mujoco.MjData, rate: float, period_s: float) -> None:
        """Set the controls for one period of at most 20 ms; `rate` in [-1, 1]: positive closes, negative opens.

        A jaw moves at `rate` times `JAW_SPEED_M_S`, and squeezes with full force what stops it. A suction head
        only heeds the sign: vacuum on, which holds wherever and whenever enough cells are covered, or off.
        """
        if self._gripper.kind == "suction":
            self._vacuum = rate > 0 or (self._vacuum and rate == 0)
            if self._vacuum:
                self._gripper.grip(model, data)
            else:
                self._gripper.release(model, data, 0.0)
            return
        # The command never runs far ahead of a blocked jaw, so that it opens as soon as it is told to.
        full_force_m = self._gripper.opening_m(model, data) - SQUEEZE_M
        wanted_m = self._opening_m - rate * JAW_SPEED_M_S * period_s
        self._opening_m = float(np.clip(wanted_m, full_force_m, self._gripper.max_opening_m))
        if self._opening_m <= full_force_m:
            self._gripper.grip(model, data)
        else:
            self._gripper.release(model, data, self._opening_m)
