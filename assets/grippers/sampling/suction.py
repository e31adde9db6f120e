"""Suction grasps on a CAD mesh: places where enough cells of the suction head's face find surface.

The face is laid on sampled surface points, square to the surface there. A ray from each cell measures the depth of
the part under it; surface within the foam's reach of the highest point covers its cell. The number of covered cells
gives the force, and their centre's distance from the centre of mass the moment that peels the face off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.sampling.boxes import points_in_boxes
from simpick.assets.grippers.sampling.part_surface import PartSurface
from simpick.assets.grippers.sampling.resting import resting_floors
from simpick.assets.grippers.sampling.selection import diverse, merged
from simpick.assets.grippers.suction_shape import (
    CELL_CENTRES_M,
    CELL_FORCE_N,
    CELLS,
    FOAM_REACH_M,
    SUCTION_RADIUS_M,
    SUCTION_TURN_SYMMETRY,
    suction_boxes,
)
from simpick.assets.part import Part
from simpick.geometry.transforms import transform
from simpick.records import Grasp


@dataclass(frozen=True)
class SuctionSampling:
    """A `GraspSampling`: the face laid on surface points."""

    seeds: int = 1200
    """Surface points on which the face is laid."""
    largest_gap_m: float = 0.8 * FOAM_REACH_M
    """Largest depth below the highest place under the face at which a cell counts as covered."""
    facing_cosine: float = 0.75
    """Least cosine between a covered cell's axis and the surface's normal."""
    least_cells: int = 4
    """Least number of covered cells."""
    least_margin: float = 2.5
    """Least holding force in multiples of the part's weight."""
    largest_peel: float = 0.8
    """Largest moment of the part's weight, as a share of what the covered cells resist."""
    candidates: int = 30
    """How many diverse grasps are kept for verification, over all approaches."""
    candidates_per_floor: int = 8
    """How many more are kept from above per resting pose of the part."""
    candidates_at_most: int = 90
    """Upper limit of the grasps kept."""
    steepness_deg: float = 47.0
    """Largest angle from the vertical of those from above."""
    spacing_m: float = 0.005
    """Least distance between two kept grasps."""

    def sample(self, part: Part) -> list[Grasp]:
        """Return diverse unverified suction grasps, best first. Deterministic."""
        surface = PartSurface(part)
        rng = np.random.default_rng(0)
        chosen = rng.choice(len(surface.points), min(self.seeds, len(surface.points)), replace=False)
        found = [_placed(surface, surface.points[k], surface.normals[k], self) for k in chosen]
        grasps = [grasp for grasp in found if grasp is not None]
        pools = [(grasps, self.candidates)]
        steep = np.cos(np.radians(self.steepness_deg))
        pools += [
            ([g for g in grasps if -g.T_part_tcp[:3, 2] @ floor[:3] > steep], self.candidates_per_floor)
            for floor in resting_floors(part)
        ]
        spacing_m, order = self.spacing_m, SUCTION_TURN_SYMMETRY
        kept = [diverse(pool, part.symmetries, order, count=count, spacing_m=spacing_m) for pool, count in pools]
        return merged(kept, part.symmetries, order, count=self.candidates_at_most, spacing_m=0.5 * spacing_m)


def _placed(
    surface: PartSurface, point: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"], settings: SuctionSampling
) -> Grasp | None:
    """Return the face laid on one surface point, or None where it covers too little or hits the part."""
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    T = transform(np.stack([u, -v, -normal], axis=-1), point)
    height = 0.006
    origins = point + height * normal + CELL_CENTRES_M[:, :1] * u - CELL_CENTRES_M[:, 1:] * v
    distances, normals = surface.cast(origins, np.tile(-normal, (CELLS, 1)))
    depths = distances - height
    # What stands out under the face must yield to the foam, or the face would not come down to the point.
    if depths.min() < -settings.largest_gap_m:
        return None
    covered = (depths - depths.min() < settings.largest_gap_m) & (normals @ normal > settings.facing_cosine)
    if covered.sum() < settings.least_cells:
        return None
    T[:3, 3] = point - float(depths.min()) * normal
    seen = (surface.points - T[:3, 3]) @ T[:3, :3]
    # The foam yields to the part by its reach; only what stands higher than that is in the head's way.
    if points_in_boxes(seen[seen[:, 2] < -FOAM_REACH_M], suction_boxes()).any():
        return None
    com = (surface.centre_of_mass_m - T[:3, 3]) @ T[:3, :3]
    lever = float(np.linalg.norm(com[:2] - CELL_CENTRES_M[covered].mean(axis=0)))
    weight = surface.part.mass_kg * 9.81
    margin = float(covered.sum()) * CELL_FORCE_N / weight
    # Off-centre weight peels the face off cell by cell: its moment against the cells' at half the face's radius.
    peel = weight * lever / (float(covered.sum()) * CELL_FORCE_N * 0.5 * SUCTION_RADIUS_M)
    if margin < settings.least_margin or peel > settings.largest_peel:
        return None
    quality = np.exp(-lever / 0.03) * np.sqrt(covered.mean()) * min(1.0, margin / 6.0)
    return Grasp(T, 0.0, float(quality))
