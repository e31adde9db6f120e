"""Random crops of bin images: moved, turned, mirrored and scaled, then made worse as cameras make images worse."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from simpick.estimators.detector.affinities import STRIDE
from simpick.rendering.camera_effects import apply_camera_effects
from simpick.training.detector.bin_data import BinImage
from simpick.training.detector.config import CropConfig


@dataclass(frozen=True, eq=False)
class Crop:
    """One training sample."""

    rgb: UInt8[np.ndarray, "size size 3"]
    ids: UInt8[np.ndarray, "cells cells"]
    """Instance in each cell, from 1; 0 is background."""


def draw_crop(image: BinImage, config: CropConfig, rng: np.random.Generator) -> Crop:
    """Return a random crop around a random instance."""
    matrix = _crop_from_image(image, config, rng)
    size = config.size_px
    blank = cv2.mean(image.rgb)
    rgb = cv2.warpAffine(image.rgb, matrix, (size, size), flags=cv2.INTER_LINEAR, borderValue=blank)
    # Cells' middles lie between pixels: in coordinates of pixel centres, cell (i, j) is at STRIDE * i + 0.5.
    cells = size // STRIDE
    to_cells = np.array([[1 / STRIDE, 0, -0.5 / STRIDE], [0, 1 / STRIDE, -0.5 / STRIDE], [0, 0, 1]])
    cell_matrix = (to_cells @ np.vstack([matrix, [0, 0, 1]]))[:2]
    ids = cv2.warpAffine(image.ids, cell_matrix, (cells, cells), flags=cv2.INTER_NEAREST, borderValue=(0,))
    return Crop(apply_camera_effects(rgb, config.effects, rng), ids)


def _crop_from_image(image: BinImage, config: CropConfig, rng: np.random.Generator) -> Float[np.ndarray, "2 3"]:
    shown = cv2.findNonZero(image.ids)
    if shown is not None:
        aim = shown.reshape(-1, 2)[int(rng.integers(len(shown)))].astype(float)
    else:
        aim = rng.random(2) * image.ids.shape[::-1]
    angle = rng.uniform(0, 2 * np.pi) if rng.random() < 0.5 else np.pi / 2 * rng.integers(4)
    scale = float(np.exp(rng.uniform(*np.log(config.scale))))
    linear = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if rng.random() < 0.5:
        linear[:, 0] *= -1
    target = config.size_px * rng.uniform(0.25, 0.75, size=2)
    return np.column_stack([linear, target - linear @ aim])
