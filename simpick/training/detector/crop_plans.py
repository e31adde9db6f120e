"""What is drawn of a crop: where it lies in its image, and what the camera does to it. No image is read for that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from simpick.rendering.camera_effects import Exposure, draw_exposure, draw_jpeg_quality
from simpick.training.detector.config import CropConfig

Areas = Int[np.ndarray, "256"]
"""Pixels of each instance of an image; element 0 counts the background."""
ANY_PART = -1
"""In place of an instance's number."""


@dataclass(frozen=True, eq=False)
class CropPlan:
    """A crop, as it was drawn; images of equal `Areas` may differ in what it shows."""

    instance: int
    """Number of the instance that the crop is placed by, or `ANY_PART`; 0 for the background."""
    pixel: int
    """Which of the instance's pixels lies at `target_px`, counted from 0 along rows."""
    linear: Float[np.ndarray, "2 2"]
    """Turns, scales and mirrors: pixels of the crop per pixel of the image."""
    target_px: Float[np.ndarray, "2"]
    """Where the pixel lies in the crop, x and y from the centre of the first pixel."""
    exposure: Exposure
    """What the camera does to the crop."""
    jpeg_quality: int | None
    """Of the crop's compression; None for none."""


def draw_plan(areas: Areas, config: CropConfig, rng: np.random.Generator) -> CropPlan:
    """Draw a crop of an image with instances of these areas."""
    instance, pixel = _draw_pixel(areas, config.instance_share, rng)
    angle = rng.uniform(0, 2 * np.pi) if rng.random() < 0.5 else np.pi / 2 * rng.integers(4)
    scale = float(np.exp(rng.uniform(*np.log(config.scale))))
    linear = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if rng.random() < 0.5:
        linear[:, 0] *= -1
    target_px = config.size_px * rng.uniform(0.25, 0.75, size=2)
    exposure = draw_exposure(config.effects, rng)
    return CropPlan(instance, pixel, linear, target_px, exposure, draw_jpeg_quality(config.effects, rng))


def _draw_pixel(areas: Areas, instance_share: float, rng: np.random.Generator) -> tuple[int, int]:
    shown = np.flatnonzero(areas[1:]) + 1
    if not len(shown):
        return 0, int(rng.integers(areas[0]))
    if rng.random() < instance_share:
        instance = int(shown[rng.integers(len(shown))])
        return instance, int(rng.integers(areas[instance]))
    return ANY_PART, int(rng.integers(areas[1:].sum()))
