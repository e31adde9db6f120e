"""Jaw grasps on a CAD mesh: antipodal pairs, approach directions, depth, clearance and a first quality.

A pair of surface points is antipodal if the line between them lies inside the friction cones of both (Nguyen 1988).
Each pair gives a closing axis; approaches are spread around it, and one straight down is added per resting pose of the
part on a floor. The grasp is then placed as deep as possible without the fingertips reaching past the part or into
that floor, centred on the surface that the pads will touch, and kept if the open fingers and the palm miss the part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.jaw_shape import (
    FINGER_THICKNESS_M,
    JAW_STROKE_M,
    JAW_TURN_SYMMETRY,
    PAD_ABOVE_TCP_M,
    PAD_WIDTH_M,
    TIP_BEYOND_TCP_M,
    jaw_boxes,
)
from simpick.assets.grippers.sampling.boxes import points_in_boxes
from simpick.assets.grippers.sampling.part_surface import PartSurface
from simpick.assets.grippers.sampling.resting import resting_floors
from simpick.assets.grippers.sampling.selection import diverse, merged
from simpick.assets.part import Part
from simpick.geometry.transforms import transform
from simpick.records import Grasp


@dataclass(frozen=True)
class AntipodalSampling:
    """A `GraspSampling`: antipodal pairs of surface points."""

    seeds: int = 500
    """Surface points from which pairs are sought."""
    approaches: int = 12
    """Approach directions around each closing axis."""
    cone_deg: float = 20.0
    """Largest angle between a pad's normal and the surface's: far inside the rubber's friction cone (47 deg)."""
    level_deg: float = 35.0
    """Largest slope of a closing axis over a floor that the part rests on."""
    side_clearance_m: float = 0.004
    """Free space that each opened finger must have towards the part itself."""
    tip_margin_m: float = 0.0015
    """How far the fingertips stay short of the part's far side, where the floor may be."""
    least_overlap_m: float = 0.002
    """Least depth of the contact inside the pad's tip."""
    patch_depth_m: float = 0.0006
    """Surface this close to a pad counts as touching it."""
    least_patch_m2: float = 6e-6
    """Least touching area on each side."""
    candidates: int = 60
    """How many diverse grasps are kept for verification, over all approaches."""
    candidates_per_floor: int = 40
    """How many more are kept per resting pose of the part."""
    candidates_at_most: int = 320
    """Upper limit of the grasps kept."""
    spacing_m: float = 0.006
    """Least distance between two kept grasps (`simpick.assets.grippers.sampling.selection.pose_distance`)."""

    def sample(self, part: Part) -> list[Grasp]:
        """Return diverse unverified jaw grasps, best first. Deterministic."""
        surface = PartSurface(part)
        rng = np.random.default_rng(0)
        axes = _closing_axes(surface, self, rng)
        angles = 2 * np.pi * np.arange(self.approaches) / self.approaches
        anywhere = [_placed(surface, _frame(point, axis, angle), self) for point, axis in axes for angle in angles]
        steepest = np.sin(np.radians(self.level_deg))
        pools = [([g for g in anywhere if g is not None], self.candidates)]
        for floor in resting_floors(part):
            level = [(point, axis) for point, axis in axes if abs(axis @ floor[:3]) < steepest]
            onto = [_placed(surface, _frame_onto(point, axis, floor[:3]), self, floor) for point, axis in level]
            pools.append(([g for g in onto if g is not None], self.candidates_per_floor))
        spacing_m, order = self.spacing_m, JAW_TURN_SYMMETRY
        kept = [diverse(pool, part.symmetries, order, count=count, spacing_m=spacing_m) for pool, count in pools]
        return merged(kept, part.symmetries, order, count=self.candidates_at_most, spacing_m=0.5 * spacing_m)


def _closing_axes(
    surface: PartSurface, settings: AntipodalSampling, rng: np.random.Generator
) -> list[tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]]:
    """Return (midpoint, unit axis) of antipodal pairs."""
    cone = np.cos(np.radians(settings.cone_deg))
    found = []
    for k in rng.choice(len(surface.points), min(settings.seeds, len(surface.points)), replace=False):
        point, normal = surface.points[k], surface.normals[k]
        axis = -normal + rng.normal(scale=0.06, size=3)
        axis /= np.linalg.norm(axis)
        for distance, far_normal in surface.crossings(point + 1e-6 * axis, axis):
            leaves = far_normal @ axis > cone and -normal @ axis > cone
            if leaves and 0.001 < distance < JAW_STROKE_M - 2 * settings.side_clearance_m:
                found.append((point + 0.5 * distance * axis, axis))
    return found


def _frame(point: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"], angle: float) -> Float[np.ndarray, "4 4"]:
    """Return T_part_tcp at `point` that closes along `axis` and approaches at `angle` around it."""
    u = _cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    u /= np.linalg.norm(u)
    z = np.cos(angle) * u + np.sin(angle) * _cross(axis, u)
    return transform(np.stack([axis, _cross(z, axis), z], axis=-1), point)


def _frame_onto(
    point: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """Return T_part_tcp at `point` that closes along `axis` and approaches against `up` as straight as possible."""
    z = axis * (axis @ up) - up
    z /= np.linalg.norm(z)
    return transform(np.stack([axis, _cross(z, axis), z], axis=-1), point)


def _cross(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Return the cross product of two vectors, for which `numpy.cross` takes ten times as long."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _placed(
    surface: PartSurface,
    T_part_tcp: Float[np.ndarray, "4 4"],
    settings: AntipodalSampling,
    floor: Float[np.ndarray, "4"] | None = None,
) -> Grasp | None:
    """Return the grasp with depth and centre adapted to the part (and its floor), or None if it cannot work."""
    R = T_part_tcp[:3, :3]
    # One row per axis, so that each comparison below reads memory in order.
    points = R.T @ (surface.points.T - T_part_tcp[:3, 3, None])
    # Most placements fail in what is beside the fingers, a small share of the part: only that is looked at first.
    chosen = np.flatnonzero(np.abs(points[1]) < PAD_WIDTH_M / 2 + 0.001)
    if not len(chosen):
        return None
    beside = points[:, chosen]
    # Push in until the tips are level with the part's far side under the fingers, but not past the sampled contact.
    far = beside[2, np.abs(beside[0]) < JAW_STROKE_M / 2 + FINGER_THICKNESS_M].max()
    shift = min(0.0, far - settings.tip_margin_m - TIP_BEYOND_TCP_M)
    if floor is not None:
        shift = min(shift, _shift_off_floor(T_part_tcp, np.ptp(beside[0]), floor, settings))
    if -shift > TIP_BEYOND_TCP_M - settings.least_overlap_m:
        return None
    beside[2] -= shift

    reached = (beside[2] > -PAD_ABOVE_TCP_M) & (beside[2] < TIP_BEYOND_TCP_M)
    across = beside[0, reached]
    lower, upper = across.min(), across.max()
    width, centre = upper - lower, 0.5 * (lower + upper)
    opening = width + 2 * settings.side_clearance_m
    if opening > JAW_STROKE_M:
        return None
    beside[0] -= centre
    touching = reached & (np.abs(beside[1]) < PAD_WIDTH_M / 2)
    cone = np.cos(np.radians(settings.cone_deg))
    depth = settings.patch_depth_m
    across_normal = surface.normals[chosen] @ R[:, 0]
    left = touching & (beside[0] < -width / 2 + depth) & (across_normal < -cone)
    right = touching & (beside[0] > width / 2 - depth) & (across_normal > cone)
    patch = surface.area_per_point_m2 * min(left.sum(), right.sum())
    if patch < settings.least_patch_m2:
        return None
    points -= np.array([[centre], [0.0], [shift]])
    if points_in_boxes(points.T, jaw_boxes(opening)).any():
        return None

    left_centre, right_centre = beside[:, left].mean(axis=1), beside[:, right].mean(axis=1)
    skew = float(np.linalg.norm((left_centre - right_centre)[1:]))
    if skew > 0.006:
        return None
    local_com = (surface.centre_of_mass_m - T_part_tcp[:3, 3]) @ R - np.array([centre, 0.0, shift])
    lever = float(np.linalg.norm((local_com - 0.5 * (left_centre + right_centre))[1:]))
    quality = np.exp(-lever / 0.03) * (0.4 + 0.6 * min(1.0, patch / 60e-6)) * np.exp(-skew / 0.006)
    T = T_part_tcp.copy()
    T[:3, 3] += R @ np.array([centre, 0.0, shift])
    return Grasp(T, float(width), float(quality))


def _shift_off_floor(
    T_part_tcp: Float[np.ndarray, "4 4"], width_m: float, floor: Float[np.ndarray, "4"], settings: AntipodalSampling
) -> float:
    """Return how far along the approach (negative: back) the lowest corner of the open fingers just clears a floor."""
    x = min(width_m, JAW_STROKE_M) / 2 + settings.side_clearance_m + FINGER_THICKNESS_M
    corners = np.array([[sx * x, sy * PAD_WIDTH_M / 2, TIP_BEYOND_TCP_M] for sx in (-1, 1) for sy in (-1, 1)])
    heights = (corners @ T_part_tcp[:3, :3].T + T_part_tcp[:3, 3]) @ floor[:3] - floor[3]
    descent = -float(T_part_tcp[:3, 2] @ floor[:3])
    return float((heights.min() - settings.tip_margin_m) / descent)
