"""From estimated poses to an ordered list of grasps in the world: feasible grasps, best first."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache, partial
from typing import Annotated

import numpy as np
import trimesh
from annotated_types import Interval, MinLen
from jaxtyping import Float

from simpick.assets.grippers import get_gripper
from simpick.assets.grippers.sampling.boxes import points_in_boxes, swept_back
from simpick.assets.part import Part
from simpick.config import Config, Fraction, NonNegativeFloat, PositiveFloat, PositiveInt
from simpick.geometry.transforms import transform_points
from simpick.grasping.exposure import exposures
from simpick.grasping.failure_memory import FailureMemory
from simpick.grasping.gripper_shape import GripperShape
from simpick.grasping.obstacle_points import ObstaclePoints
from simpick.grasping.part_grasps import symmetric_grasps
from simpick.grasping.unexplained import UnexplainedSpace
from simpick.records import Grasp
from simpick.scene.config import BinConfig
from simpick.scene.workspace import bin_interior

_SURFACE_POINTS = 700
_NEAR_M = 0.3
"""What is unexplained further from a target's origin cannot be in the way of its grasps."""


@dataclass(frozen=True)
class PlannerConfig(Config):
    """What a grasp in the world must fulfil, and what makes one better than another."""

    largest_tilt_deg: Annotated[float, Interval(gt=0, le=90)] = 50.0
    """Largest angle between the approach and straight down."""
    wall_clearance_m: float = 0.0015
    """Free space between the gripper and the bin's walls."""
    most_back_off_m: PositiveFloat = 0.006
    """A jaw grasp whose fingertips would meet the floor is drawn back along its approach, by this much at most: its
    contacts move towards the tips, which reach 10 mm beyond the TCP."""
    floor_clearance_m: float = 0.0008
    """Free space between the fingertips and the bin's floor."""
    part_clearance_m: float = 0.001
    """Free space between the gripper and every other part."""
    side_clearances_m: Annotated[tuple[NonNegativeFloat, ...], MinLen(1)] = (0.006, 0.003)
    """Free space between each open finger and the target; a later entry only where an earlier one does not fit."""
    most_points_touched: int = 12
    """Where parts are entangled, the gripper may touch others: at most this many of the 700 points drawn on each part
    may be in its way. Parts yield; a solid hit would cover far more points."""
    touching_factor: float = 0.05
    """Quality factor of a grasp that touches other parts, divided again by 1 + the points touched: it is tried when
    no free grasp is left."""
    unexplained_points: PositiveFloat = 10.0
    """Meeting this many points of what no estimate explains divides a grasp's quality by e, ..."""
    unexplained_factor: Fraction = 0.02
    """... and meeting any number, by this factor at most."""
    approach_m: float = 0.08
    """Length of the straight approach that must be free."""
    grasps_per_target: PositiveInt = 6
    """At most this many grasps of one part are returned, so that the next choice may be another part."""
    tries_per_target: PositiveInt = 300
    """At most this many of a part's best-scored grasps are tested for collisions."""


@dataclass(frozen=True, eq=False)
class WorldGrasp:
    """A grasp of one estimated part, in the world."""

    T_world_tcp: Float[np.ndarray, "4 4"]
    """TCP at the grasp; the jaw's half turn and suction's free turn about z are left to the motion planner."""
    grasp: Grasp
    target: int
    """Index of the part among those given to `GraspPlanner.plan`."""
    opening_m: float
    """Opening during the approach; 0 for grippers without one."""
    quality: float
    """What the list is ordered by, in [0, 1]."""
    exposure: float
    """Share of the target that no other part covers."""


class Rejection(StrEnum):
    """Why a grasp is left out."""

    DOUBTFUL = "of improbable poses"
    """Below `TRUSTED_SCORE`, where it is known what the image shows."""
    FAILED = "failed before"
    TILT = "tilted too far"
    BIN = "meet the bin"
    PARTS = "meet other parts"
    REACH = "out of reach"
    """Of the arm; `GraspPlanner` does not check it."""


@dataclass(frozen=True, eq=False)
class _Target:
    """One part's grasps that are to be checked for collisions."""

    index: int
    origin_m: Float[np.ndarray, "3"]
    grasps: list[Grasp]
    Ts_world_tcp: Float[np.ndarray, "n 4 4"]
    order: list[int]
    """Those to be checked, best first."""
    scores: list[float]
    """Of these, in the same order: what each is worth at most."""
    exposure: float


class GraspPlanner:
    """Filters and ranks grasps of one gripper in one bin. Holds the parts' grasps and surface points."""

    def __init__(self, gripper: str, bin: BinConfig, config: PlannerConfig | None = None) -> None:
        self.gripper, self.config = get_gripper(gripper), config or PlannerConfig()
        interior = bin_interior(bin)
        clearance_m = self.config.wall_clearance_m
        self._lower = [side + clearance_m for side in interior.lower_m]
        self._upper = [side - clearance_m for side in interior.upper_m]
        self._least_descent = np.cos(np.radians(self.config.largest_tilt_deg))
        self._over_rim_m = interior.upper_m[2] + clearance_m
        self._back_m = np.array([[0.0], [0.5 * self.config.approach_m], [self.config.approach_m]])
        self._grasps: dict[str, tuple[list[Grasp], Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n"]]] = {}
        self._points: dict[str, Float[np.ndarray, "n 3"]] = {}
        self._shape = lru_cache(maxsize=1024)(
            partial(
                GripperShape.of,
                self.gripper,
                approach_m=self.config.approach_m,
                clearance_m=self.config.part_clearance_m,
            )
        )

    def prepare(self, part: Part) -> None:
        """Load (or sample, verify and store) the part's grasps; `plan` does it where this has not been done."""
        if part.content_hash not in self._grasps:
            grasps = symmetric_grasps(part, self.gripper.name)
            Ts = np.stack([g.T_part_tcp for g in grasps]) if grasps else np.zeros((0, 4, 4))
            self._grasps[part.content_hash] = grasps, Ts, np.array([g.quality for g in grasps])
            points = trimesh.sample.sample_surface(part.mesh, _SURFACE_POINTS, seed=0)[0]
            self._points[part.content_hash] = np.asarray(points, float)

    def plan(
        self,
        parts: Sequence[Part],
        Ts_world_part: Sequence[Float[np.ndarray, "4 4"]],
        *,
        scores: Sequence[float] | None = None,
        memory: FailureMemory | None = None,
    ) -> list[WorldGrasp]:
        """Return all grasps of `search`, best first; an empty list if there are none."""
        return list(self.search(parts, Ts_world_part, scores=scores, memory=memory))

    def search(
        self,
        parts: Sequence[Part],
        Ts_world_part: Sequence[Float[np.ndarray, "4 4"]],
        *,
        scores: Sequence[float] | None = None,
        memory: FailureMemory | None = None,
        unexplained: UnexplainedSpace | None = None,
        rejected: Counter[Rejection] | None = None,
    ) -> Iterator[WorldGrasp]:
        """Yield the grasps that can be carried out, best first; each is tested only when it may be the next.

        `parts[k]` is estimated at `Ts_world_part[k]`, with a confidence `scores[k]` in [0, 1] if given. Every part is
        an obstacle to the others. With what the estimates leave `unexplained`, those that it does not trust are not
        grasped, and a grasp that only these rule out is a last choice; so is one that meets what is unexplained.
        Reach is not checked. Grasps that are left out are counted in `rejected`, as far as they have been tested.
        """
        for part in parts:
            self.prepare(part)
        clouds = [
            transform_points(T, self._points[part.content_hash]) for part, T in zip(parts, Ts_world_part, strict=True)
        ]
        rejected = Counter() if rejected is None else rejected
        weights, open_share = self._weights(clouds, scores)
        everything = frozenset(range(len(clouds)))
        trusted = everything if unexplained is None else unexplained.trusted
        targets = [
            self._target(k, parts[k], Ts_world_part[k], weights[k], float(open_share[k]), memory, rejected)
            for k in sorted(trusted)
        ]
        rejected[Rejection.DOUBTFUL] += sum(len(self._grasps[parts[k].content_hash][0]) for k in everything - trusted)
        obstacles = ObstaclePoints.of(clouds)
        solid = obstacles if trusted == everything else obstacles.of_owners(trusted)
        # A target is worth at most the score of its best grasp not tested yet. What is found takes a place of its own.
        queue: list[tuple[float, int, int, _Target | WorldGrasp]] = [
            (-target.scores[0], target.index, 0, target) for target in targets if target.scores
        ]
        heapq.heapify(queue)
        testing: dict[int, Iterator[tuple[list[WorldGrasp], float]]] = {}
        made: Counter[int] = Counter()
        while queue:
            *_, best = heapq.heappop(queue)
            if isinstance(best, WorldGrasp):
                yield best
                continue
            if best.index not in testing:
                doubtful = np.zeros((0, 3)) if unexplained is None else unexplained.around(best.index)
                doubtful = doubtful[np.linalg.norm(doubtful - best.origin_m, axis=-1) < _NEAR_M]
                testing[best.index] = self._tested(best, obstacles, solid, doubtful, rejected)
            grasps, bound = next(testing[best.index])
            for grasp in grasps:
                made[best.index] += 1
                heapq.heappush(queue, (-grasp.quality, best.index, made[best.index], grasp))
            if bound > -np.inf:
                heapq.heappush(queue, (-bound, best.index, made[best.index] + 1, best))

    def _weights(
        self, clouds: Sequence[Float[np.ndarray, "_ 3"]], scores: Sequence[float] | None
    ) -> tuple[list[float], Float[np.ndarray, "parts"]]:
        """Return what each part's grasps are worth for its confidence, exposure and height, and its exposure."""
        open_share = exposures(clouds)
        tops = [float(cloud[:, 2].max()) for cloud in clouds]
        weights = []
        for k, top in enumerate(tops):
            # Lower parts come later, so that no part is pulled out from under another.
            height = np.exp(-(max(tops) - top) / 0.08)
            weight = float((0.1 + 0.9 * open_share[k] ** 2) * (0.6 + 0.4 * height))
            weights.append(weight if scores is None else weight * float(np.clip(scores[k], 0.0, 1.0)))
        return weights, open_share

    def _target(
        self,
        index: int,
        part: Part,
        T_world_part: Float[np.ndarray, "4 4"],
        weight: float,
        exposure: float,
        memory: FailureMemory | None,
        rejected: Counter[Rejection],
    ) -> _Target:
        """Return the part's grasps that are steep enough and did not fail before, best first."""
        grasps, Ts_part_tcp, qualities = self._grasps[part.content_hash]
        Ts_world_tcp = T_world_part @ Ts_part_tcp
        descent = -Ts_world_tcp[:, 2, 2]
        scores = weight * qualities * descent.clip(0, 1) ** 2
        usable = descent > self._least_descent
        steep = int(np.count_nonzero(usable))
        if memory is not None and len(memory):
            factors = memory.factors(part, T_world_part, Ts_world_tcp)
            scores = scores * factors
            usable &= factors > 0
        kept = usable.nonzero()[0]
        rejected[Rejection.TILT] += len(grasps) - steep
        rejected[Rejection.FAILED] += steep - len(kept)
        order = kept[np.argsort(-scores[kept], kind="stable")][: self.config.tries_per_target]
        return _Target(
            index, T_world_part[:3, 3], grasps, Ts_world_tcp, order.tolist(), scores[order].tolist(), exposure
        )

    def _tested(
        self,
        target: _Target,
        obstacles: ObstaclePoints,
        solid: ObstaclePoints,
        doubtful: Float[np.ndarray, "m 3"],
        rejected: Counter[Rejection],
    ) -> Iterator[tuple[list[WorldGrasp], float]]:
        """Yield the part's feasible grasps as they are found, and what those that may follow are worth at most.

        One grasp is tested for each, the best-scored first, until `grasps_per_target` are free. Only where none is,
        those that touch others come, last of all; if there are none either, those that only what is not `solid` rules
        out.
        """
        config, free, blocked = self.config, 0, False
        touching: list[WorldGrasp] = []
        for rank, following in enumerate([*target.scores[1:], -np.inf]):
            found, brushing, why = self._tried(target, rank, obstacles, doubtful)
            touching += brushing
            if why is not None:
                rejected[why] += 1
                blocked |= why is Rejection.PARTS
            free += found is not None
            if free == config.grasps_per_target:
                following = -np.inf
            bound = following if free else max(following, config.touching_factor * target.scores[0])
            yield [] if found is None else [found], bound
        ordered = sorted(touching, key=lambda g: -g.quality)[: config.grasps_per_target]
        if not ordered and blocked and solid is not obstacles:
            # What is improbable keeps away, but does not rule out.
            possible = self._tested(target, solid, solid, doubtful, Counter())
            ordered = [replace(g, quality=g.quality * config.touching_factor) for grasps, _ in possible for g in grasps]
        yield ordered, -np.inf

    def _tried(
        self, target: _Target, rank: int, obstacles: ObstaclePoints, doubtful: Float[np.ndarray, "m 3"]
    ) -> tuple[WorldGrasp | None, list[WorldGrasp], Rejection | None]:
        """Return a grasp as it is free; else as it touches others, with each opening; else why it is left out."""
        config, k = self.config, target.order[rank]
        grasp, T, score = target.grasps[k], target.Ts_world_tcp[k], target.scores[rank]
        clearances = config.side_clearances_m if self.gripper.max_opening_m > 0 else (0.0,)
        brushing: list[WorldGrasp] = []
        why: Rejection | None = Rejection.BIN
        for choice, clearance in enumerate(clearances):
            shape = self._shape(min(grasp.width_m + 2 * clearance, self.gripper.max_opening_m))
            T_world_tcp, back_m = self._off_the_floor(T, shape.edges)
            if back_m > config.most_back_off_m or not self._clears_bin(T_world_tcp, shape.edges):
                continue
            why = Rejection.PARTS
            touched = self._touched(T_world_tcp, shape, obstacles, target.index)
            if touched > config.most_points_touched:
                continue
            why = None
            quality = score * 0.8**choice * (1 - 0.5 * back_m / config.most_back_off_m)
            if touched:
                quality *= config.touching_factor / (1 + touched)
            if len(doubtful):
                quality *= self._doubt(T_world_tcp, shape.opening_m, doubtful)
            found = WorldGrasp(T_world_tcp, grasp, target.index, shape.opening_m, quality, target.exposure)
            # A narrower opening may be free where a wider one brushes something.
            if not touched:
                return found, brushing, None
            brushing.append(found)
        return None, brushing, why

    def _doubt(
        self, T_world_tcp: Float[np.ndarray, "4 4"], opening_m: float, doubtful: Float[np.ndarray, "n 3"]
    ) -> float:
        """Return the quality factor of a grasp among points where something may be."""
        points = (doubtful - T_world_tcp[:3, 3]) @ T_world_tcp[:3, :3]
        boxes = np.concatenate(
            [swept_back(self.gripper.boxes(opening_m), self.config.approach_m), self.gripper.grip_boxes(opening_m)]
        )
        met = int(points_in_boxes(points, boxes).sum())
        return max(self.config.unexplained_factor, float(np.exp(-met / self.config.unexplained_points)))

    def _off_the_floor(
        self, T_world_tcp: Float[np.ndarray, "4 4"], edges: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "4 4"], float]:
        """Return the grasp drawn back along its approach until the fingertips clear the floor, and by how much (m).

        A gripper that is pressed on stays where it is: `_clears_bin` refuses a grasp below the floor.
        """
        if self.gripper.press_m > 0:
            return T_world_tcp, 0.0
        lowest_m = float((edges @ T_world_tcp[:3, :3].T)[:, 2].min() + T_world_tcp[2, 3])
        missing_m = max(0.0, self.config.floor_clearance_m + 1e-6 - lowest_m)
        back_m = missing_m / max(-float(T_world_tcp[2, 2]), 1e-3)
        drawn_back = T_world_tcp.copy()
        drawn_back[:3, 3] -= back_m * T_world_tcp[:3, 2]
        return drawn_back, back_m

    def _clears_bin(self, T_world_tcp: Float[np.ndarray, "4 4"], edges: Float[np.ndarray, "n 3"]) -> bool:
        """Return whether the open gripper and its straight approach keep clear of the bin's walls and floor."""
        body = T_world_tcp[:3, :3] @ edges.T + T_world_tcp[:3, 3:]
        if body[2].min() < 0.0:
            return False
        x, y, z = body[:, None] - self._back_m * T_world_tcp[:3, 2, None, None]
        (left, front, _), (right, rear, _) = self._lower, self._upper
        inside = (x > left) & (x < right) & (y > front) & (y < rear)
        return bool((inside | (z >= self._over_rim_m)).all())

    def _touched(
        self, T_world_tcp: Float[np.ndarray, "4 4"], shape: GripperShape, obstacles: ObstaclePoints, target: int
    ) -> int:
        """Return how many points on other parts lie in the way of the open gripper and its straight approach.

        A point that the closing gripper would take along counts as one too many.
        """
        _, lower_m, upper_m = shape.extents[0]
        # Over the pile the palm meets nothing, and the fingers are a fifth as wide.
        around = shape.around_from(obstacles.back_m(T_world_tcp, lower_m, upper_m))
        touched, gripped = shape.points_met(obstacles.around_box(T_world_tcp, *around, beside=target))
        return self.config.most_points_touched + 1 if gripped else touched
