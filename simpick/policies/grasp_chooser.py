"""`GraspChooser`: the best grasp, among those of all estimated parts, that the arm can reach."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import Bool

from simpick.assets.part import Part
from simpick.grasping import FailureMemory, GraspPlanner, Rejection, UnexplainedSpace, WorldGrasp
from simpick.motion import MotionConfig, NoPlan, PickPlanner
from simpick.records import CameraFrame, PoseEstimate
from simpick.scene import SceneConfig
from simpick.scene.workspace import tcp_workspace

MAX_REACH_CHECKS = 40
"""Reach is checked for this many of the best grasps before none is chosen."""


@dataclass(frozen=True, eq=False)
class Choice:
    """The grasp to carry out."""

    grasp: WorldGrasp | None
    """None if there is none."""
    rejected: Counter[Rejection]
    """How many better grasps were left out, by reason."""


class GraspChooser:
    """Plans grasps and checks that the arm reaches them. Keeps no state between bins, so policies may share one."""

    def __init__(self, parts: Sequence[Part], config: SceneConfig) -> None:
        """Prepare the grasps of `parts`; verifying those of a part that is new to the cache takes seconds."""
        self.parts = tuple(parts)
        self.workspace = tcp_workspace(config.bin)
        """Where the TCP may be commanded to."""
        self._part_of = {part.name: part for part in parts}
        self._rim_m = config.bin.depth_m
        self._motion = PickPlanner(config, MotionConfig())
        self._grasps = GraspPlanner(config.gripper, config.bin)
        self.max_opening_m = self._grasps.gripper.max_opening_m
        """Of the gripper; 0 if it has no opening."""
        for part in parts:
            self._grasps.prepare(part)

    def choose(
        self,
        estimates: Sequence[PoseEstimate],
        frame: CameraFrame,
        memory: FailureMemory,
        foreground: Bool[np.ndarray, "height width"] | None = None,
    ) -> Choice:
        """Return the best grasp that the arm can reach, and how many were left out on the way there.

        `foreground` are the pixels of `frame` that show parts: what no estimate explains of them is an obstacle.
        """
        parts = [self._part_of[estimate.part] for estimate in estimates]
        Ts_world_part = [frame.T_world_camera @ estimate.T_camera_part for estimate in estimates]
        scores = [estimate.score for estimate in estimates]
        rejected: Counter[Rejection] = Counter()
        unexplained = None
        if foreground is not None:
            unexplained = UnexplainedSpace.of(
                foreground, frame.camera, frame.T_world_camera, parts, Ts_world_part, scores, self._rim_m
            )
        grasps = self._grasps.search(
            parts, Ts_world_part, scores=scores, memory=memory, unexplained=unexplained, rejected=rejected
        )
        for grasp in islice(grasps, MAX_REACH_CHECKS):
            if self._reachable(grasp):
                return Choice(grasp, rejected)
            rejected[Rejection.REACH] += 1
        return Choice(None, rejected)

    def _reachable(self, grasp: WorldGrasp) -> bool:
        inside = bool(self.workspace.contains(grasp.T_world_tcp[None, :3, 3])[0])
        return inside and not isinstance(self._motion.plan(grasp.T_world_tcp, grasp.opening_m), NoPlan)
