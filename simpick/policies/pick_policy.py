"""`PickPolicy`: look, choose the best grasp of the best part, remember what failed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simpick.assets.part import Part
from simpick.envs.actions import ABSTAIN, encode_action
from simpick.envs.observations import frame_from_observation
from simpick.envs.spaces import outcome_from_index
from simpick.grasping import FailureMemory, GraspPlanner, WorldGrasp
from simpick.policies.perception import Percept, Perception
from simpick.records import PickOutcome, PoseEstimate


@dataclass(frozen=True, eq=False)
class Decision:
    """What the policy saw and chose for one pick: for recording and evaluation."""

    percept: Percept
    grasp: WorldGrasp | None
    """None if the policy abstained."""
    abstained: PickOutcome | None
    """Why it abstained: `NOTHING_DETECTED` or `NO_GRASP`; None if it did not."""
    plan_s: float
    """Wall-clock seconds of choosing the grasp."""

    @property
    def target(self) -> PoseEstimate | None:
        """Return the estimate that the grasp was chosen on."""
        return None if self.grasp is None else self.percept.estimates[self.grasp.target]
