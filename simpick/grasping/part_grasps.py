"""The grasps of a part: sampled, verified in simulation once, stored, and repeated over the part's symmetries."""

from __future__ import annotations

from collections.abc import Callable

from simpick.assets.grippers import get_gripper
from simpick.assets.grippers.sampling.selection import expanded
from simpick.assets.part import Part
from simpick.grasping.store import cached_path, load_grasps, save_grasps
from simpick.grasping.verification import verified
from simpick.records import Grasp

ENOUGH = 120
"""Grasps that are enough for a new part. Candidates come from each resting pose in turn, the best first. Random parts
with up to 320 candidates were picked as well with the first 100 of them: 3 parts, 2 bins of 12 each, all 72 grasps."""


def candidate_grasps(part: Part, gripper: str) -> list[Grasp]:
    """Return diverse grasps of `part` that no simulation has verified yet, best first. Deterministic.

    Raises:
        UnknownNameError: there is no such gripper.
    """
    return get_gripper(gripper).sampling.sample(part)


def verified_grasps(part: Part, gripper: str, on_share: Callable[[float], None] | None = None) -> list[Grasp]:
    """Return grasps that held in simulation, best first, one per symmetry class.

    They come from the files that ship for library parts, else from the disk cache; otherwise this takes about five
    seconds once, and `on_share` is called meanwhile with the share of it that is done.

    Raises:
        UnknownNameError: there is no such gripper.
    """
    grasps = load_grasps(part, gripper)
    if grasps is None:
        # The file holds float32: reading it back makes the first run equal to the second.
        found = verified(part, candidate_grasps(part, gripper), gripper, enough=ENOUGH, on_share=on_share)
        save_grasps(cached_path(part, gripper), part, gripper, found)
        grasps = load_grasps(part, gripper)
    return grasps or []


def symmetric_grasps(part: Part, gripper: str) -> list[Grasp]:
    """Return the part's verified grasps under all of its symmetries; see `verified_grasps`."""
    return expanded(verified_grasps(part, gripper), part.symmetries)
