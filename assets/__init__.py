"""What a scene is made of: parts, bins, robots, grippers and shipped weights.

The names below are imported when they are first used, so that ``import simpick.assets`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simpick.assets.library import get_part as get_part
    from simpick.assets.library import library_part_names as library_part_names
    from simpick.assets.library import part_names as part_names
    from simpick.assets.part import Material as Material
    from simpick.assets.part import Part as Part
    from simpick.assets.random_parts import random_part as random_part
    from simpick.assets.symmetry_detection import detect_symmetries as detect_symmetries
    from simpick.assets.user_parts import CadImport as CadImport
    from simpick.assets.user_parts import CadSettings as CadSettings
    from simpick.assets.user_parts import add_user_part as add_user_part
    from simpick.assets.user_parts import import_cad as import_cad
    from simpick.assets.user_parts import load_cad as load_cad
    from simpick.assets.user_parts import remove_user_part as remove_user_part

_HOME = {
    "get_part": "library",
    "library_part_names": "library",
    "part_names": "library",
    "Material": "part",
    "Part": "part",
    "random_part": "random_parts",
    "detect_symmetries": "symmetry_detection",
    "CadImport": "user_parts",
    "CadSettings": "user_parts",
    "add_user_part": "user_parts",
    "import_cad": "user_parts",
    "load_cad": "user_parts",
    "remove_user_part": "user_parts",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
