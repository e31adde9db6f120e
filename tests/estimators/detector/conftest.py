"""A bin of a few library parts that lie apart, seen by the overhead camera."""

from dataclasses import dataclass

import pytest

from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.records import CameraFrame
from simpick.rendering import SceneRenderer
from simpick.scene import SceneConfig, build_scene


@dataclass(frozen=True)
class SeenBin:
    frame: CameraFrame
    names: tuple[str, ...]
    """The part of each instance."""
    parts: tuple[Part, ...]
    """Those that the bin is filled from."""


@pytest.fixture(scope="session")
def seen_bin() -> SeenBin:
    names = ("hex_nut", "connecting_rod", "pipe_tee")
    scene = build_scene(SceneConfig(parts=names, count=6, robot=None), 5)
    with SceneRenderer(scene) as renderer:
        frame = renderer.capture("overhead")
    return SeenBin(frame, tuple(i.part.name for i in scene.instances), tuple(get_part(name) for name in names))
