"""`PickPolicy`: look, choose the best grasp of the best part, remember what failed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.envs.actions import ABSTAIN, encode_action
from simpick.envs.observations import frame_from_observation
from simpick.envs.spaces import outcome_from_index
from simpick.errors import ConfigError
from simpick.grasping import FailureMemory, GraspPlanner, WorldGrasp
from simpick.motion import MotionConfig, NoPlan, PickPlanner
from simpick.policies.perception import Percept, Perception
from simpick.records import PickOutcome, PoseEstimate
from simpick.scene import SceneConfig
from simpick.scene.workspace import tcp_workspace

MAX_REACH_CHECKS = 40
"""The arm is asked for its way to so many of the best grasps before the policy abstains."""


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


class PickPolicy:
    """Looks, estimates poses, chooses the best grasp that the arm can reach, and remembers what failed.

    The same object plays many episodes; call `reset` between them. `decision` tells what the last `act` was based on.
    """

    def __init__(self, perception: Perception, parts: Sequence[Part], config: SceneConfig) -> None:
        """Pick `parts`, in the order of the environment's `part_names`, in the cell that `config` describes.

        Onboards the parts: rendering templates and verifying grasps may take seconds for a part that is new to the
        cache.
        """
        self.perception = perception
        self.parts = tuple(parts)
        self._part_of = {part.name: part for part in parts}
        self._workspace = tcp_workspace(config.bin)
        self._motion = PickPlanner(config, MotionConfig())
        self._planner = GraspPlanner(cast("Literal['jaw', 'suction']", config.gripper), config.bin)
        self._memory = FailureMemory()
        self._decision: Decision | None = None
        perception.onboard(parts)
        for part in parts:
            self._planner.prepare(part)

    @property
    def decision(self) -> Decision:
        """Return what the last `act` was based on.

        Raises:
            ConfigError: `act` has not been called since the last `reset`.
        """
        if self._decision is None:
            raise ConfigError("the policy has decided nothing yet: call act(observation) first")
        return self._decision

    def reset(self) -> None:
        """Forget the last episode."""
        self._memory.forget()
        self._decision = None

    def act(self, observation: dict[str, Any]) -> np.ndarray:
        """Return the action of the best grasp; `ABSTAIN` where nothing is seen or no grasp passes."""
        self._learn(outcome_from_index(int(observation["last_outcome"])))
        percept = self.perception.perceive(frame_from_observation(observation), self.parts)
        start = time.perf_counter()
        grasp = self._choose(percept.estimates, observation["T_world_camera"])
        plan_s = time.perf_counter() - start
        if grasp is None:
            why = PickOutcome.NO_GRASP if percept.detections else PickOutcome.NOTHING_DETECTED
            self._decision = Decision(percept, None, why, plan_s)
            return ABSTAIN
        self._decision = Decision(percept, grasp, None, plan_s)
        return encode_action(grasp.T_world_tcp, grasp.opening_m, self._workspace)

    def _choose(self, estimates: Sequence[PoseEstimate], T_world_camera: Float[np.ndarray, "4 4"]) -> WorldGrasp | None:
        """Return the best grasp that the arm can reach."""
        parts = [self._part_of[estimate.part] for estimate in estimates]
        self._Ts_world_part = [T_world_camera @ estimate.T_camera_part for estimate in estimates]
        scores = [estimate.score for estimate in estimates]
        grasps = self._planner.plan(parts, self._Ts_world_part, scores=scores, memory=self._memory)
        return next((grasp for grasp in grasps[:MAX_REACH_CHECKS] if self._reachable(grasp)), None)

    def _learn(self, outcome: PickOutcome | None) -> None:
        """Remember the last attempt if it failed."""
        if outcome in (None, PickOutcome.SUCCESS) or self._decision is None or self._decision.target is None:
            return
        grasp = self._decision.grasp
        assert grasp is not None
        T_world_part = self._Ts_world_part[grasp.target]
        self._memory.remember(self._decision.target.part, T_world_part, grasp.T_world_tcp)

    def _reachable(self, grasp: WorldGrasp) -> bool:
        inside = bool(self._workspace.contains(grasp.T_world_tcp[None, :3, 3])[0])
        return inside and not isinstance(self._motion.plan(grasp.T_world_tcp, grasp.opening_m), NoPlan)
