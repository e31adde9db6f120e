"""Suction grasps on a CAD mesh: places where the whole cup finds surface within the reach of its lip.

The cup is laid on sampled surface points. Rays from its rim and from inside it measure how deep the surface lies
under each; a plane fitted to them gives the cup's tilt, and what remains is what the lip must bridge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.suction import CUP_FORCE_N, CUP_RADIUS_M, LIP_REACH_M, SuctionGripper
from simpick.assets.part import Part
from simpick.geometry.transforms import transform
from simpick.grasping.boxes import points_in_boxes
from simpick.grasping.part_surface import PartSurface
from simpick.grasping.resting import resting_floors
from simpick.grasping.selection import diverse, merged
from simpick.records import Grasp


@dataclass(frozen=True)
class SuctionConfig:
    """How suction grasps are sampled."""

    seeds: int = 1200
    """Surface points on which the cup is laid."""
    rim_rays: int = 8
    """Rays around the lip; half as many are cast inside of it."""
    largest_gap_m: float = 1.6 * LIP_REACH_M
    """Largest spread of the surface's depth under the cup: the lip stretches and the bellows give."""
    largest_tilt_deg: float = 12.0
    """Largest angle between the sampled normal and the plane fitted under the cup."""
    candidates: int = 30
    """How many diverse grasps are kept for verification, wherever they approach from."""
    candidates_per_floor: int = 8
    """And how many more from above for each way in which the part comes to rest."""
    candidates_at_most: int = 90
    """But not more than this."""
    steepness_deg: float = 33.0
    """Largest angle from the vertical of those."""
    spacing_m: float = 0.005
    """Least distance between two kept grasps."""


def suction_candidates(part: Part, config: SuctionConfig = SuctionConfig()) -> list[Grasp]:
    """Return diverse unverified suction grasps, best first. Deterministic."""
    surface = PartSurface(part)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(surface.points), min(config.seeds, len(surface.points)), replace=False)
    found = [_placed(surface, surface.points[k], surface.normals[k], config) for k in chosen]
    grasps = [grasp for grasp in found if grasp is not None]
    pools = [(grasps, config.candidates)]
    steep = np.cos(np.radians(config.steepness_deg))
    for floor in resting_floors(part):
        pools.append(([g for g in grasps if -g.T_part_tcp[:3, 2] @ floor[:3] > steep], config.candidates_per_floor))
    return merged(
        [diverse(pool, part.symmetries, count=count, spacing_m=config.spacing_m) for pool, count in pools],
        part.symmetries,
        count=config.candidates_at_most,
        spacing_m=0.5 * config.spacing_m,
    )


def _placed(
    surface: PartSurface, point: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"], config: SuctionConfig
) -> Grasp | None:
    """Return the cup laid on one surface point, or None where it would leak or hit the part."""
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    angles = 2 * np.pi * np.arange(config.rim_rays) / config.rim_rays
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * (CUP_RADIUS_M - 0.0007)
    disc = np.concatenate([rim, 0.5 * rim[::2], np.zeros((1, 2))])
    height = 0.004
    origins = point + height * normal + disc[:, :1] * u + disc[:, 1:] * v
    distances, _ = surface.cast(origins, np.tile(-normal, (len(disc), 1)))
    if not (distances < height + 0.004).all():
        return None
    # Elevation over the disc as a plane a x + b y + c: the plane is the cup's tilt, the residual is the lip's work.
    design = np.column_stack([disc, np.ones(len(disc))])
    plane, *_ = np.linalg.lstsq(design, height - distances, rcond=None)
    gap = float(np.ptp(height - distances - design @ plane))
    tilt = float(np.arctan(np.linalg.norm(plane[:2])))
    if gap > config.largest_gap_m or tilt > np.radians(config.largest_tilt_deg):
        return None
    approach = plane[0] * u + plane[1] * v - normal
    approach /= np.linalg.norm(approach)
    # The lip meets the highest place under it first.
    rise = float((height - distances - design @ plane)[: config.rim_rays].max())
    centre = point + (plane[2] + rise) * normal
    x_axis = u - approach * (u @ approach)
    x_axis /= np.linalg.norm(x_axis)
    T = transform(np.stack([x_axis, np.cross(approach, x_axis), approach], axis=-1), centre)

    seen = (surface.points - centre) @ T[:3, :3]
    # The cup itself sinks onto the part by its compliance, so only what stands higher is in its way.
    if points_in_boxes(seen[seen[:, 2] < -0.0025], SuctionGripper().boxes()).any():
        return None
    com = (surface.centre_of_mass_m - centre) @ T[:3, :3]
    lever = float(np.linalg.norm(com[:2]))
    # The lip resists tilting by the vacuum's force at its radius; what the part's weight uses of it is lost.
    load = surface.part.mass_kg * 9.81 * lever / (CUP_FORCE_N * CUP_RADIUS_M)
    if load > 0.7:
        return None
    quality = (1 - load) * np.exp(-lever / 0.04) * (1 - 0.6 * gap / config.largest_gap_m)
    return Grasp(T, 0.0, "suction", float(quality))
