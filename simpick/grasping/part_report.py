"""What is known about picking a part before anything is picked: its grasps by gripper, and what will be hard."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from simpick.assets.convex_pieces import excess_volume
from simpick.assets.grippers.sampling.resting import resting_floors
from simpick.assets.part import Part
from simpick.grasping.coverage import resting_coverage
from simpick.grasping.part_grasps import candidate_grasps, verified_grasps
from simpick.scene.config import SceneConfig

LEAST_COVERAGE = 0.05
"""Below this share of resting poses with two feasible grasps, a gripper cannot empty a bin of the part."""
ENOUGH_COVERAGE = 0.95
"""Below this share, parts are left over that lie the wrong way: of tall bellows at 0.85, 5 of 16."""
_LEAST_PIXELS = 150
"""A part must cover so many pixels of the overhead image to be found and estimated with some certainty."""
_LEAST_WIDE_PX = 6
_HEAVY_KG = 0.4
_LARGEST_EXCESS = 0.1


@dataclass(frozen=True)
class Gripping:
    """How well one gripper can hold a part."""

    gripper: str
    sampled: int
    """Grasps that were sampled on the mesh."""
    verified: int
    """Grasps that held in simulation."""
    coverage: float
    """Share of the resting poses that offer two feasible grasps."""

    @property
    def is_possible(self) -> bool:
        """Return whether there is a grasp that more than a few resting parts offer."""
        return self.verified > 0 and self.coverage >= LEAST_COVERAGE


def gripping(part: Part, gripper: str, on_share: Callable[[float], None] | None = None) -> Gripping:
    """Return what `gripper` can do with `part`.

    A new part's grasps are verified first, which takes some seconds; `on_share` is called with the share that is done.
    """
    found = len(verified_grasps(part, gripper, on_share))
    sampled = found if found else len(candidate_grasps(part, gripper))
    return Gripping(gripper, sampled, found, resting_coverage(part, gripper) if found else 0.0)


def recommended(options: Sequence[Gripping]) -> Gripping | None:
    """Return the gripper that covers most resting poses, None if none can hold the part; the first wins a tie."""
    best = max(options, key=lambda option: round(option.coverage, 2))
    return best if best.is_possible else None


def resting_poses(part: Part) -> int:
    """Return in how many ways the part comes to rest on a floor, its symmetries apart."""
    return len(resting_floors(part))


def pixels_in_overhead_image(part: Part, config: SceneConfig | None = None) -> tuple[float, float]:
    """Return how many pixels the part covers, and how many it is wide, on average over its resting poses' views."""
    config = config or SceneConfig()
    seen_m = 2 * config.overhead_height_m * np.tan(np.radians(config.overhead.fovy_deg / 2))
    per_metre = config.overhead.height_px / seen_m
    # A convex body's mean shadow is a quarter of its surface (Cauchy).
    hull = part.mesh.convex_hull
    return float(hull.area / 4 * per_metre**2), float(np.sort(part.extents_m)[1] * per_metre)


def difficulties(part: Part, options: Sequence[Gripping], config: SceneConfig | None = None) -> Iterator[str]:
    """Yield a sentence for each reason why the part will be hard to see, to hold or to simulate."""
    config = config or SceneConfig()
    area, width = pixels_in_overhead_image(part, config)
    if area < _LEAST_PIXELS or width < _LEAST_WIDE_PX:
        yield (
            f"small in the image: about {area:.0f} pixels, {width:.1f} wide, where {_LEAST_PIXELS} and {_LEAST_WIDE_PX}"
            " are needed to be found with some certainty; the oracle does not need them"
        )
    longest, shortest = float(part.extents_m.max()), float(part.extents_m.min())
    inner = min(config.bin.length_m, config.bin.width_m)
    if longest > 0.5 * inner:
        yield f"long: {longest * 1e3:.0f} mm in a bin of {inner * 1e3:.0f} mm: it leans on walls, and few fit in"
    if shortest < 0.003:
        yield f"thin: lying flat it is {shortest * 1e3:.1f} mm high, where fingertips and pose errors need about 3 mm"
    if part.mass_kg > _HEAVY_KG:
        yield f"heavy: {part.mass_kg * 1e3:.0f} g, where the grippers were made for up to {_HEAVY_KG * 1e3:.0f} g"
    excess = excess_volume(part.mesh, part.collision) if part.mesh.is_volume else 0.0
    if excess > _LARGEST_EXCESS:
        yield f"simulated as a thicker shape: the collision pieces fill {excess:.0%} more than its volume"
    for option in options:
        if not option.is_possible:
            yield f"{option.gripper}: cannot hold it: {no_grasp_reason(option)}"
        elif option.coverage < ENOUGH_COVERAGE:
            yield f"{option.gripper}: only {option.coverage:.0%} of its resting poses can be gripped; others are left"


def no_grasp_reason(option: Gripping) -> str:
    """Return which filter left no grasp."""
    if option.sampled == 0:
        return "no place on its surface suits the gripper (too wide, too narrow, too curved or too small)"
    if option.verified == 0:
        return f"none of {option.sampled} sampled grasps holds in simulation (it slips, turns or is knocked away)"
    return (
        f"two of its {option.verified} grasps can be reached in only {option.coverage:.0%} of its resting poses (they "
        "approach from below, from the side, or where the floor is in the way)"
    )
