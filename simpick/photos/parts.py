"""The parts that are looked for: mesh files, names, and onboarding files."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from simpick.activity import counted
from simpick.assets import get_part, load_cad
from simpick.assets.cad_import import is_mesh_path
from simpick.assets.face_colours import with_file_colours
from simpick.assets.part import Part
from simpick.assets.units import Unit, split_unit
from simpick.assets.user_parts import user_part_file
from simpick.photos.onboarding_file import SUFFIX, load_onboarding


def load_parts(parts: Sequence[Part | str | Path], unit: Unit = "auto") -> list[Part]:
    """Return the parts; `unit` is that of mesh files.

    Raises:
        MeshError: a file cannot become a part.
        UnknownPartError: there is no part of this name.
        ArrayFileError, ConfigError: an onboarding file is damaged, or of other versions.
    """
    return [part if isinstance(part, Part) else _load(str(part), unit) for part in counted(parts, "reading part")]


def _load(text: str, unit: Unit) -> Part:
    if Path(text).suffix == SUFFIX:
        return load_onboarding(Path(text))
    if not is_mesh_path(text):
        copied = user_part_file(text)
        return get_part(text) if copied is None else _coloured(get_part(text), copied)
    file, own_unit = split_unit(text)
    given = own_unit if unit == "auto" else unit
    return _coloured(get_part(text) if given == own_unit else load_cad(file, unit=given), Path(file))


@lru_cache(maxsize=64)
def _coloured(part: Part, path: Path) -> Part:
    """Return a part with its file's colours: the same object for the same part, which others keep by identity."""
    return with_file_colours(part, path)
