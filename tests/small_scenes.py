"""Bins of two kinds of parts with small images, which tests share."""

from simpick.scene import SceneConfig
from simpick.scene.config import CameraConfig


def small_scene(*parts: str, count: int, width_px: int = 160, height_px: int = 120) -> SceneConfig:
    """Return a plain bin seen by an overhead camera of this size."""
    return SceneConfig(
        parts=parts,
        count=count,
        randomization="none",
        overhead=CameraConfig(width_px, height_px, 28.0),
        overview=CameraConfig(64, 48, 42.0),
    )
