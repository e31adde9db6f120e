"""The grasps of a part: sampled, verified in simulation once, stored, and repeated over the part's symmetries."""

from __future__ import annotations

from simpick.assets.part import Part
from simpick.errors import ConfigError
from simpick.grasping.antipodal import antipodal_candidates
from simpick.grasping.selection import expanded
from simpick.grasping.store import Kind, cached_path, load_grasps, save_grasps
from simpick.grasping.suction_sampling import suction_candidates
from simpick.grasping.verification import verified
from simpick.records import Grasp


def candidate_grasps(part: Part, kind: Kind) -> list[Grasp]:
    """Return diverse grasps of `part` that no simulation has tried yet, best first. Deterministic."""
    if kind == "jaw":
        return antipodal_candidates(part)
    if kind == "suction":
        return suction_candidates(part)
    raise ConfigError(f"grasp kind must be 'jaw' or 'suction', got {kind!r}")


def verified_grasps(part: Part, kind: Kind) -> list[Grasp]:
    """Return grasps that held in simulation, best first, one of each symmetry class.

    They come from the files that ship for library parts, else from the disk cache; otherwise this takes about five
    seconds once.
    """
    grasps = load_grasps(part, kind)
    if grasps is None:
        # A reader of the file gets float32; so does the maker, lest the first run differ from the second.
        save_grasps(cached_path(part, kind), part, kind, verified(part, candidate_grasps(part, kind)))
        grasps = load_grasps(part, kind)
    return grasps or []


def jaw_grasps(part: Part) -> list[Grasp]:
    """Return the part's verified jaw grasps under all of its symmetries. Stored, see `verified_grasps`."""
    return expanded(verified_grasps(part, "jaw"), part.symmetries)


def suction_grasps(part: Part) -> list[Grasp]:
    """Return the part's verified suction grasps under all of its symmetries. Stored, see `verified_grasps`."""
    return expanded(verified_grasps(part, "suction"), part.symmetries)
