"""`get_part`: a part by its name or by a path to a mesh file."""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path

from simpick.assets import user_parts
from simpick.assets.cad_import import is_mesh_path, load_cad, name_from_path
from simpick.assets.library_parts import BUILDERS
from simpick.assets.part import Part
from simpick.assets.random_parts import random_part, seed_from_name
from simpick.assets.units import Unit, split_unit
from simpick.errors import UnknownPartError


def part_names() -> list[str]:
    """Return the names that `get_part` takes, sorted: the library's and those that the user added."""
    return sorted({*BUILDERS, *user_parts.user_part_names()})


def get_part(name_or_path: str | Path) -> Part:
    """Return a part by a library name, a name the user added, or a path to a CAD file.

    A path may end with its unit, as in ``block.stl@cm``; ``random_<seed>`` names the training part of that seed. The
    same name gives the same object until a file behind it changes. A file whose own name is a library part's becomes
    ``<name>_cad``, so that both fit into one scene.
    Raises `UnknownPartError`, which lists the names, and `MeshError` for a file that cannot become a part.
    """
    name = str(name_or_path)
    if name in BUILDERS:
        return _library_part(name)
    if (seed := seed_from_name(name)) is not None:
        return random_part(seed)
    if is_mesh_path(name):
        file, unit = split_unit(name)
        path = Path(file)
        return _part_of_file(path, unit, path.stat().st_mtime_ns if path.is_file() else 0)
    if name in user_parts.user_part_names():
        settings = user_parts.user_parts_dir() / name / "part.json"
        return _added_part(name, settings, settings.stat().st_mtime_ns)
    raise UnknownPartError(name, part_names())


@cache
def _library_part(name: str) -> Part:
    return BUILDERS[name]()


# The time stamps are only keys: a file that was replaced is read again.


@lru_cache(maxsize=64)
def _part_of_file(path: Path, unit: Unit, _modified_ns: int) -> Part:
    name = name_from_path(path)
    return load_cad(path, unit=unit, name=f"{name}_cad" if name in part_names() else name)


@lru_cache(maxsize=64)
def _added_part(name: str, _settings: Path, _modified_ns: int) -> Part:
    return user_parts.load_user_part(name)
