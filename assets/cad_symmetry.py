"""The symmetries of a CAD file's part: detected once, or chosen, and named where a part is nearly a revolution."""

from __future__ import annotations

import numpy as np
import trimesh

from simpick.assets.symmetry_choice import SymmetryChoice
from simpick.assets.symmetry_detection import RELATIVE_TOLERANCE, detect_symmetries, nearest_revolution
from simpick.caching import cache_dir, cache_key, cached_arrays
from simpick.geometry.symmetry import ContinuousSymmetry, SymmetryGroup

_CACHE_VERSION = 2
_HIGH_ORDER = 5
_TAKEN = 2.0
"""A high order that turns of any angle fit almost as well, within this multiple of the tolerance, is a revolution."""
_NAMED = 4.0
"""A part that any turn moves by less than this multiple of the tolerance is said to be nearly a revolution."""


def cad_symmetries(mesh: trimesh.Trimesh, choice: SymmetryChoice = "auto") -> tuple[SymmetryGroup, str]:
    """Return the symmetries of a watertight mesh (in metres) and a phrase that describes them.

    Detection takes seconds for cubes and the like, so it is cached under ``<cache>/symmetries``.
    """
    if choice == "none":
        return SymmetryGroup(), "none, as asked for"
    found, nearest, deviation_m = _cached(mesh)
    if choice == "revolution":
        return nearest, f"{describe_symmetry(nearest)}, as asked for; a turn moves the surface by {_mm(deviation_m)} mm"
    if found.continuous:
        return found, describe_symmetry(found)
    tolerance_m = RELATIVE_TOLERANCE * float(np.linalg.norm(mesh.extents))
    if len(found.discrete) + 1 >= _HIGH_ORDER and deviation_m < _TAKEN * tolerance_m:
        return nearest, (
            f"nearly a {describe_symmetry(nearest)}: any turn about {_axis(nearest)} moves the surface by at most "
            f"{_mm(deviation_m)} mm and counts as equal (--symmetry none: as different)"
        )
    if deviation_m < _NAMED * tolerance_m:
        return found, (
            f"{describe_symmetry(found)}; nearly a revolution about {_axis(nearest)}, which moves the surface by at "
            f"most {_mm(deviation_m)} mm (--symmetry revolution: such turns count as equal)"
        )
    return found, describe_symmetry(found)


def describe_symmetry(group: SymmetryGroup) -> str:
    """Return the group in a few words."""
    if group.is_ball or (group.continuous and len(group.discrete) > 1):
        return "sphere"
    if group.continuous:
        return "revolution, ends alike" if len(group.discrete) else "revolution"
    return f"{len(group.discrete) + 1} rotations" if len(group.discrete) else "none"


def _cached(mesh: trimesh.Trimesh) -> tuple[SymmetryGroup, SymmetryGroup, float]:
    """Return the detected symmetries, the nearest revolution and by how much (m) that moves the surface."""
    key = cache_key(_CACHE_VERSION, np.asarray(mesh.vertices).tobytes(), np.asarray(mesh.faces).tobytes())
    path = cache_dir() / "symmetries" / f"{key}.npz"

    def detected() -> dict[str, np.ndarray]:
        found = detect_symmetries(mesh)
        if found.continuous and len(found.discrete) > 1:
            # Three axes state a ball exactly; a list of tilts does not, and is hundreds of times longer.
            centre = np.asarray(mesh.center_mass)
            found = SymmetryGroup(continuous=tuple(ContinuousSymmetry.of(axis, centre) for axis in np.eye(3)))
        nearest, deviation = (found, 0.0) if found.continuous else nearest_revolution(mesh)
        return {
            "discrete": found.discrete, "axes": _rows(found),
            "near_discrete": nearest.discrete, "near_axes": _rows(nearest), "deviation": np.array(deviation),
        }  # fmt: skip

    stored = cached_arrays(path, ("discrete", "axes", "near_discrete", "near_axes", "deviation"), detected)
    groups = (_group(stored["discrete"], stored["axes"]), _group(stored["near_discrete"], stored["near_axes"]))
    return *groups, float(stored["deviation"])


def _rows(group: SymmetryGroup) -> np.ndarray:
    return np.array([[*symmetry.axis, *symmetry.offset_m] for symmetry in group.continuous]).reshape(-1, 6)


def _group(discrete: np.ndarray, rows: np.ndarray) -> SymmetryGroup:
    return SymmetryGroup(discrete, tuple(ContinuousSymmetry.of(row[:3], row[3:]) for row in rows))


def _axis(group: SymmetryGroup) -> str:
    return f"({', '.join(f'{x:.2g}' for x in group.continuous[0].axis)})"


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.2g}"
