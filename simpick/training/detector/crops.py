"""Random crops of bin images: moved, turned, mirrored and scaled, then made worse as cameras make images worse."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from simpick.estimators.detector.affinities import STRIDE
from simpick.training.detector.bin_data import BinImage
from simpick.training.detector.config import CropConfig


@dataclass(frozen=True, eq=False)
class Crop:
    """One training sample."""

    rgb: UInt8[np.ndarray, "size size 3"]
    ids: UInt8[np.ndarray, "cells cells"]
    """Instance in each cell, from 1; 0 is background."""
    centres: Float[np.ndarray, "instances 2"]
    """(row, column) of the middle of each instance's visible pixels, in cells; it may lie outside the crop. Entry k
    is that of instance k + 1."""


def draw_crop(image: BinImage, config: CropConfig, rng: np.random.Generator) -> Crop:
    """Return a random crop around a random instance."""
    matrix = _crop_from_image(image, config, rng)
    size = config.size_px
    blank = tuple(int(v) for v in image.rgb.mean(axis=(0, 1)))
    rgb = cv2.warpAffine(image.rgb, matrix, (size, size), flags=cv2.INTER_LINEAR, borderValue=blank)
    # Cells' middles lie between pixels: in coordinates of pixel centres, cell (i, j) is at STRIDE * i + 0.5.
    cells = size // STRIDE
    to_cells = np.array([[1 / STRIDE, 0, -0.5 / STRIDE], [0, 1 / STRIDE, -0.5 / STRIDE], [0, 0, 1]])
    cell_matrix = (to_cells @ np.vstack([matrix, [0, 0, 1]]))[:2]
    ids = cv2.warpAffine(image.ids, cell_matrix, (cells, cells), flags=cv2.INTER_NEAREST, borderValue=(0,))
    centres = _centres(image.ids, len(image.fractions))
    moved = centres[:, ::-1] @ cell_matrix[:, :2].T + cell_matrix[:, 2]
    return Crop(_degraded(rgb, config, rng), ids, moved[:, ::-1].astype(np.float32))


def _crop_from_image(image: BinImage, config: CropConfig, rng: np.random.Generator) -> Float[np.ndarray, "2 3"]:
    rows, columns = np.nonzero(image.ids)
    if len(rows):
        k = rng.integers(len(rows))
        aim = np.array([columns[k], rows[k]], float)
    else:
        aim = rng.random(2) * image.ids.shape[::-1]
    angle = rng.uniform(0, 2 * np.pi) if rng.random() < 0.5 else np.pi / 2 * rng.integers(4)
    scale = float(np.exp(rng.uniform(*np.log(config.scale))))
    linear = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if rng.random() < 0.5:
        linear[:, 0] *= -1
    target = config.size_px * rng.uniform(0.25, 0.75, size=2)
    return np.column_stack([linear, target - linear @ aim])


def _centres(ids: UInt8[np.ndarray, "height width"], count: int) -> Float[np.ndarray, "instances 2"]:
    """Return the mean (row, column) of each instance's pixels, (0, 0) where it has none."""
    rows, columns = np.nonzero(ids)
    numbers = ids[rows, columns].astype(np.int64) - 1
    sizes = np.maximum(np.bincount(numbers, minlength=count), 1)
    sums = [np.bincount(numbers, weights=values, minlength=count) for values in (rows, columns)]
    return np.stack(sums, axis=1) / sizes[:, None]


def _degraded(
    rgb: UInt8[np.ndarray, "size size 3"], config: CropConfig, rng: np.random.Generator
) -> UInt8[np.ndarray, "size size 3"]:
    """Return the image in another exposure and white balance, often blurred, noisy, compressed or without colour."""
    x = rgb.astype(np.float32) / 255
    x = x ** float(np.exp(rng.uniform(-config.brightness, config.brightness)))
    if rng.random() < config.grey_share:
        x = np.repeat(x @ np.array([[0.299], [0.587], [0.114]], np.float32), 3, axis=2)
    else:
        grey = x.mean(axis=2, keepdims=True)
        x = grey + rng.uniform(0.4, 1.4) * (x - grey)
        x = x * (1 + rng.uniform(-config.colour, config.colour, 3)).astype(np.float32)
    middle = float(x.mean())
    x = middle + (1 + rng.uniform(-config.brightness, config.brightness)) * (x - middle)
    x = x * (1 + rng.uniform(-config.brightness, config.brightness))
    if rng.random() < 0.3:
        x = x * _light_gradient(x.shape[0], rng)[..., None]
    if rng.random() < 1 / 3:
        x = cv2.GaussianBlur(x, (0, 0), rng.uniform(0.3, config.blur_px))
    if rng.random() < 0.5:
        x = x + rng.normal(0, rng.uniform(0, config.noise / 255), x.shape).astype(np.float32)
    out = np.clip(255 * x, 0, 255).astype(np.uint8)
    if rng.random() < config.jpeg_share:
        quality = int(rng.integers(40, 96))
        file = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        out = np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR), np.uint8)
    return out


def _light_gradient(size: int, rng: np.random.Generator) -> Float[np.ndarray, "size size"]:
    corners = rng.uniform(0.6, 1.25, (2, 2)).astype(np.float32)
    return cv2.resize(corners, (size, size), interpolation=cv2.INTER_LINEAR)
