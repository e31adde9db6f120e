"""`PickPolicy`: perceive, choose the best grasp of the best part, remember failures."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.envs.actions import ABSTAIN, encode_action
from simpick.envs.observations import frame_from_observation
from simpick.envs.spaces import outcome_from_index
from simpick.errors import ConfigError
from simpick.estimators.base import PoseRefiner
from simpick.estimators.boundary import without_truth
from simpick.geometry import invert
from simpick.grasping import FailureMemory, Rejection, View, WorldGrasp
from simpick.policies.closer_look import CloserLook, silhouette
from simpick.policies.grasp_chooser import GraspChooser
from simpick.policies.perception import Percept, Perception
from simpick.records import CameraFrame, PickOutcome, PoseEstimate
from simpick.scene import SceneConfig


@dataclass(frozen=True, eq=False)
class Decision:
    """What the policy saw and chose for one pick: for recording and evaluation."""

    percept: Percept
    """Where a pose has failed and nothing has changed since, with the next hypothesis in its place."""
    frame: CameraFrame
    """What was seen; the percept's poses are given in its camera."""
    grasp: WorldGrasp | None
    """None if the policy abstained."""
    abstained: PickOutcome | None
    """Why it abstained: `NOTHING_DETECTED` or `NO_GRASP`; None if it did not."""
    rejected: Counter[Rejection]
    """How many better grasps were left out, by reason."""
    plan_s: float
    """Wall-clock seconds of choosing the grasp."""

    @property
    def target(self) -> PoseEstimate | None:
        """Return the estimate that the grasp was chosen on."""
        return None if self.grasp is None else self.percept.estimates[self.grasp.target]

    @property
    def T_world_target(self) -> Float[np.ndarray, "4 4"] | None:
        """Return the pose of the target in the world."""
        return None if self.target is None else self.frame.T_world_camera @ self.target.T_camera_part


class PickPolicy:
    """Looks, estimates poses, chooses the best grasp that the arm can reach, and remembers what failed.

    The same object plays many episodes; call `reset` between them. `decision` holds what the last `act` was based on.
    """

    def __init__(
        self,
        perception: Perception,
        parts: Sequence[Part],
        config: SceneConfig,
        *,
        chooser: GraspChooser | None = None,
        look_closer: PoseRefiner | None = None,
    ) -> None:
        """Pick `parts`, in the order of the environment's `part_names`, in the cell that `config` describes.

        Onboards the parts: rendering templates and verifying grasps may take seconds for a part that is new to the
        cache. Policies for the same parts and cell may share one `chooser`. With a refiner to `look_closer`,
        set ``env.on_look = policy.look``: the grasp is corrected by the wrist camera before the descent.
        """
        self.perception = perception
        self.parts = tuple(parts)
        self._memory = FailureMemory()
        self._closer = None if look_closer is None else CloserLook(look_closer, perception.detector, parts)
        self._decision: Decision | None = None
        self.closer_view: PoseEstimate | None = None
        self._T_world_closer: Float[np.ndarray, "4 4"] | None = None
        """Estimate of the last `look`, in the wrist camera; None if it found nothing."""
        if chooser is None:
            with ThreadPoolExecutor(1) as background:
                # Sampling grasps occupies one core, and describing templates not much more: together they take less
                # long. The estimators stay in this thread, for OpenGL contexts belong to the thread that made them.
                made = background.submit(GraspChooser, parts, config)
                perception.onboard(parts)
                chooser = made.result()
        else:
            perception.onboard(parts)
        self._chooser = chooser

    @property
    def decision(self) -> Decision:
        """Return what the last `act` was based on.

        Raises:
            ConfigError: `act` has not been called since the last `reset`.
        """
        if self._decision is None:
            raise ConfigError("the policy has decided nothing yet: call act(observation) first")
        return self._decision

    @property
    def looks_closer(self) -> bool:
        """Return whether `look` can be called: the policy has a refiner."""
        return self._closer is not None

    def reset(self) -> None:
        """Forget the last episode."""
        self._memory.forget()
        self._decision = None

    def act(self, observation: dict[str, Any]) -> np.ndarray:
        """Return the action of the best grasp; `ABSTAIN` where nothing is seen or no grasp passes."""
        return self.decide(observation, self.perception.perceive(frame_from_observation(observation), self.parts))

    def decide(self, observation: dict[str, Any], percept: Percept) -> np.ndarray:
        """Return the action for an observation whose percept is known: what `act` does after looking."""
        frame = without_truth(frame_from_observation(observation))
        self._learn(outcome_from_index(int(observation["last_outcome"])))
        self._memory.look(frame.rgb)
        self.closer_view = self._T_world_closer = None
        start = time.perf_counter()
        percept = replace(percept, estimates=tuple(map(partial(self._not_ruled_out, frame), percept.estimates)))
        choice = self._chooser.choose(percept.estimates, frame, self._memory, percept.foreground)
        grasp, why = choice.grasp, None
        if grasp is None:
            why = PickOutcome.NO_GRASP if percept.detections else PickOutcome.NOTHING_DETECTED
        plan_s = time.perf_counter() - start
        self._decision = Decision(percept, frame, grasp, why, choice.rejected, plan_s)
        if grasp is None:
            return ABSTAIN
        chooser = self._chooser
        return encode_action(grasp.T_world_tcp, grasp.opening_m, chooser.workspace, chooser.max_opening_m)

    def look(self, frame: CameraFrame, T_world_tcp: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"] | None:
        """Return the TCP pose of the last decision corrected by an image from the wrist; None if nothing is found.

        `closer_view` holds the estimate.

        Raises:
            ConfigError: the policy was made without a refiner to look closer.
        """
        if self._closer is None:
            raise ConfigError("look needs a policy with a refiner: PickPolicy(..., look_closer=refiner)")
        self.closer_view = self._T_world_closer = None
        target, T_world_part = self.decision.target, self.decision.T_world_target
        if target is None or T_world_part is None:
            return None
        self.closer_view = self._closer.refined(frame, target.part, T_world_part)
        if self.closer_view is None:
            return None
        self._T_world_closer = frame.T_world_camera @ self.closer_view.T_camera_part
        return self._T_world_closer @ invert(T_world_part) @ T_world_tcp

    @property
    def T_world_target(self) -> Float[np.ndarray, "4 4"] | None:
        """Return where the last decision's target was seen last: closely, if it was found again, else from above."""
        if self._T_world_closer is not None:
            return self._T_world_closer
        return self.decision.T_world_target

    def _learn(self, outcome: PickOutcome | None) -> None:
        """Remember the last attempt if it failed."""
        decision = self._decision
        if outcome in (None, PickOutcome.SUCCESS) or decision is None or decision.target is None:
            return
        T_world_part = decision.T_world_target
        assert decision.grasp is not None and T_world_part is not None
        part = self._part(decision.target)
        view = View.of(decision.frame.rgb, silhouette(decision.frame, part, decision.target.T_camera_part))
        missed = outcome is PickOutcome.MISSED
        self._memory.remember(part, T_world_part, decision.grasp.T_world_tcp, missed=missed, view=view)

    def _not_ruled_out(self, frame: CameraFrame, estimate: PoseEstimate) -> PoseEstimate:
        """Return the estimate, with its best hypothesis that memory does not rule out, if there is one."""
        part = self._part(estimate)
        if not self._memory.is_ruled_out(part, frame.T_world_camera @ estimate.T_camera_part):
            return estimate
        for other in estimate.hypotheses[1:]:
            if not self._memory.is_ruled_out(part, frame.T_world_camera @ other.T_camera_part):
                return replace(estimate, T_camera_part=other.T_camera_part)
        return estimate

    def _part(self, estimate: PoseEstimate) -> Part:
        return next(part for part in self.parts if part.name == estimate.part)
