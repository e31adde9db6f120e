"""Random crops of bin images: moved, turned, mirrored and scaled, then made worse as cameras make images worse."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from simpick.estimators.detector.affinities import STRIDE
from simpick.rendering.camera_effects import compress_jpeg, expose
from simpick.training.detector.bin_data import BinImage
from simpick.training.detector.crop_plans import ANY_PART, Areas, CropPlan


@dataclass(frozen=True, eq=False)
class Crop:
    """One training sample."""

    rgb: UInt8[np.ndarray, "size size 3"]
    ids: UInt8[np.ndarray, "cells cells"]
    """Instance in each cell, from 1; 0 is background."""


def instance_areas(ids: UInt8[np.ndarray, "height width"]) -> Areas:
    """Return how many pixels each instance has, and the background."""
    return cv2.calcHist([ids], [0], None, [256], [0.0, 256.0]).ravel().astype(np.int64)


def cut_crop(image: BinImage, plan: CropPlan, size_px: int, rng: np.random.Generator) -> Crop:
    """Return the planned crop of an image; `rng` draws the noise."""
    matrix = _crop_from_image(image, plan)
    blank = cv2.mean(image.rgb)
    rgb = cv2.warpAffine(image.rgb, matrix, (size_px, size_px), flags=cv2.INTER_LINEAR, borderValue=blank)
    # Cells' middles lie between pixels: in coordinates of pixel centres, cell (i, j) is at STRIDE * i + 0.5.
    cells = size_px // STRIDE
    to_cells = np.array([[1 / STRIDE, 0, -0.5 / STRIDE], [0, 1 / STRIDE, -0.5 / STRIDE], [0, 0, 1]])
    cell_matrix = (to_cells @ np.vstack([matrix, [0, 0, 1]]))[:2]
    ids = cv2.warpAffine(image.ids, cell_matrix, (cells, cells), flags=cv2.INTER_NEAREST, borderValue=(0,))
    return Crop(compress_jpeg(expose(rgb, plan.exposure, rng), plan.jpeg_quality), ids)


def _crop_from_image(image: BinImage, plan: CropPlan) -> Float[np.ndarray, "2 3"]:
    is_instance = image.ids > 0 if plan.instance == ANY_PART else image.ids == plan.instance
    row, column = divmod(int(np.flatnonzero(is_instance)[plan.pixel]), image.ids.shape[1])
    return np.column_stack([plan.linear, plan.target_px - plan.linear @ [column, row]])
