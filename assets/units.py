"""Which unit a CAD file is in: files rarely state it, so the size decides, and the choice is explained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from simpick.errors import ConfigError, MeshError

Unit: TypeAlias = Literal["auto", "mm", "cm", "m", "inch"]

METRES_PER_UNIT: dict[str, float] = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}

SMALLEST_M, LARGEST_M = 0.005, 0.3
"""A part's longest side: smaller cannot be gripped, larger does not fit into the bin."""


@dataclass(frozen=True)
class UnitChoice:
    """The unit of a file's coordinates, and why."""

    unit: str
    metres_per_unit: float
    note: str
    """One sentence for the user who provided the file."""


def choose_unit(longest_side: float, unit: str = "auto", *, file: str = "the file") -> UnitChoice:
    """Return the unit of a file whose longest side is this many units.

    "auto" takes millimetres or metres, whichever makes the part 5 mm to 300 mm long: the two ranges do not overlap.
    Raises `MeshError` if neither does or if the given unit makes a part of another size, `ConfigError` for a unit
    that does not exist.
    """
    if unit not in get_args(Unit):
        raise ConfigError(f"unit must be one of {', '.join(get_args(Unit))}, got {unit!r}")
    if unit != "auto":
        scale = METRES_PER_UNIT[unit]
        if not SMALLEST_M <= longest_side * scale <= LARGEST_M:
            raise MeshError(_size_text(longest_side, f"is not in {unit}, as asked for", file))
        return UnitChoice(unit, scale, f"{file}: read in {unit}, as asked for ({_mm(longest_side * scale)} long)")
    for candidate, other in (("mm", "m"), ("m", "mm")):
        scale = METRES_PER_UNIT[candidate]
        if SMALLEST_M <= longest_side * scale <= LARGEST_M:
            unlikely = _mm(longest_side * METRES_PER_UNIT[other])
            note = (
                f"{file}: read in {candidate}, because that makes it {_mm(longest_side * scale)} long "
                f"(in {other} it would be {unlikely}); pass a unit to override"
            )
            return UnitChoice(candidate, scale, note)
    raise MeshError(_size_text(longest_side, "is so neither in mm nor in m", file))


def _size_text(longest_side: float, which: str, file: str) -> str:
    sizes = ", ".join(f"{_mm(longest_side * scale)} in {name}" for name, scale in METRES_PER_UNIT.items())
    fitting = [n for n, scale in METRES_PER_UNIT.items() if SMALLEST_M <= longest_side * scale <= LARGEST_M]
    remedy = (
        f"If it is in {' or '.join(fitting)}, pass that unit; on the command line: "
        f"simpick parts add FILE --unit {fitting[0]}"
        if fitting
        else "No unit fits (mm, cm, m, inch): scale the model"
    )
    return (
        f"{file}: the longest side must be between {_mm(SMALLEST_M)} and {_mm(LARGEST_M)}, and {which}: it would be "
        f"{sizes}. {remedy}"
    )


def _mm(metres: float) -> str:
    length = metres * 1e3
    return f"{length:.4g} mm" if length < 1e4 else f"{length:.0f} mm"
