"""Which unit a CAD file is in: files rarely state it, so the most plausible size decides, and the note says why."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, TypeAlias, cast, get_args

from simpick.errors import ConfigError, MeshError

Unit: TypeAlias = Literal["auto", "mm", "cm", "m", "inch"]

METRES_PER_UNIT: dict[str, float] = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}

SMALLEST_M, LARGEST_M = 0.001, 1.0
"""A part's longest side: outside this range contacts cannot be simulated at the scene's time step."""
USUAL_M = (0.005, 0.3)
"""Range of the longest side of parts that are picked from a bin; a unit that leads there is plausible."""
_ORDER = ("mm", "m", "inch", "cm")
"""Units by how often files are in them."""
_IN_NAME = {"mm": "mm", "cm": "cm", "inch": "inch", "inches": "inch"}


@dataclass(frozen=True)
class UnitChoice:
    """The unit of a file's coordinates, and why."""

    unit: str
    metres_per_unit: float
    note: str
    """One sentence for the user who provided the file."""


def choose_unit(
    longest_side: float, unit: str = "auto", *, file: str = "the file", stated: str | None = None
) -> UnitChoice:
    """Return the unit of a file whose longest side is this many units.

    "auto" takes the unit that the file states (`stated`) or that its name contains (``block_cm.stl``), where that makes
    a possible size, else the first of mm, m, inch and cm in which the part is 5 mm to 300 mm long, else 1 mm to 1 m.
    Raises `MeshError` if none does or if the given unit makes a part of another size, `ConfigError` for a unit that
    does not exist.
    """
    if unit not in get_args(Unit):
        raise ConfigError(f"unit must be one of {', '.join(get_args(Unit))}, got {unit!r}")
    chosen, reason = (unit, "as asked for") if unit != "auto" else _guess(longest_side, file, stated)
    if not _fits(longest_side, chosen, SMALLEST_M, LARGEST_M):
        raise MeshError(_size_text(longest_side, chosen, reason, file))
    length = longest_side * METRES_PER_UNIT[chosen]
    note = f"{file}: read in {chosen}, {reason} ({_mm(length)} long"
    if unit == "auto" and chosen != stated:
        others = other_lengths(longest_side, chosen)
        note += f"; {others}" * bool(others)
        return UnitChoice(chosen, METRES_PER_UNIT[chosen], f"{note}). For another unit: {file}@UNIT, or --unit")
    return UnitChoice(chosen, METRES_PER_UNIT[chosen], f"{note})")


def other_lengths(longest_side: float, chosen: str) -> str:
    """Return how long a part would be in the other possible units; an empty text if there are none."""
    others = [name for name in _ORDER if name != chosen and _fits(longest_side, name, SMALLEST_M, LARGEST_M)]
    return "; ".join(f"{_mm(longest_side * METRES_PER_UNIT[name])} in {name}" for name in others)


def split_unit(path: str) -> tuple[str, Unit]:
    """Return path and unit of a text such as ``block.stl@cm``; the unit is "auto" where none is given."""
    head, separator, unit = path.rpartition("@")
    return (head, cast("Unit", unit)) if separator and unit in METRES_PER_UNIT else (path, "auto")


def _guess(longest_side: float, file: str, stated: str | None) -> tuple[str, str]:
    """Return the most plausible unit and the reason."""
    if stated is not None and _fits(longest_side, stated, SMALLEST_M, LARGEST_M):
        return stated, "as the file states"
    words = re.findall(r"[a-z]+", file.rpartition(".")[0].lower())
    named = [_IN_NAME[word] for word in words if word in _IN_NAME]
    if named and _fits(longest_side, named[0], SMALLEST_M, LARGEST_M):
        return named[0], "because its name says so"
    for least, most in (USUAL_M, (SMALLEST_M, LARGEST_M)):
        for unit in _ORDER:
            if _fits(longest_side, unit, least, most):
                return unit, "because that makes its size plausible"
    return "mm", "which is usual"


def _fits(longest_side: float, unit: str, least_m: float, most_m: float) -> bool:
    return least_m * (1 - 1e-9) <= longest_side * METRES_PER_UNIT[unit] <= most_m * (1 + 1e-9)


def _size_text(longest_side: float, unit: str, reason: str, file: str) -> str:
    sizes = ", ".join(f"{_mm(longest_side * scale)} in {name}" for name, scale in METRES_PER_UNIT.items())
    fitting = [name for name in METRES_PER_UNIT if _fits(longest_side, name, SMALLEST_M, LARGEST_M)]
    remedy = (
        f"If it is in {' or '.join(fitting)}, give that unit: {file}@{fitting[0]}, or --unit {fitting[0]}"
        if fitting
        else "No unit fits (mm, cm, m, inch): scale the model"
    )
    return (
        f"{file}: the longest side must be between {_mm(SMALLEST_M)} and {_mm(LARGEST_M)}, the limits of the contact "
        f"simulation, and is not in {unit}, {reason}: it would be {sizes}. {remedy}"
    )


def _mm(metres: float) -> str:
    length = metres * 1e3
    return f"{length:.4g} mm" if length < 1e4 else f"{length:.0f} mm"
