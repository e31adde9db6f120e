"""Augmentation of queries: rotation in the image plane, frame and mask, exact by a virtual camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Interval
from jaxtyping import Bool, Float

from simpick.config import Config, Fraction


@dataclass(frozen=True)
class AugmentationConfig(Config):
    """How strongly queries are changed."""

    turn: bool = True
    """Rotate each query about the optical axis by a random angle."""
    box_jitter: Annotated[float, Interval(ge=0, lt=1)] = 0.03
    """Standard deviation of a box's shift and relative size, as a share of its longer side."""
    ragged_share: Fraction = 0.4
    """Share of masks that are grown or shrunk by one or two pixels."""
    hidden_share: Fraction = 0.25
    """Share of queries of which a straight cut hides a further part."""
    brightness: Annotated[float, Interval(ge=0, lt=1)] = 0.25
    """Largest relative change of brightness and contrast."""


def perturb_mask(
    mask: Bool[np.ndarray, "size size"], config: AugmentationConfig, rng: np.random.Generator
) -> Bool[np.ndarray, "size size"]:
    """Return the mask as a detector might find it; unchanged where too few pixels would be left."""
    out = mask
    if rng.random() < config.hidden_share:
        out = out & _half_plane(mask, rng)
    if rng.random() < config.ragged_share:
        kernel = np.ones((3, 3), np.uint8)
        steps = int(rng.integers(1, 3))
        operation = cv2.erode if rng.random() < 0.5 else cv2.dilate
        out = operation(out.astype(np.uint8), kernel, iterations=steps) > 0
    return out if out.sum() >= max(30, 0.4 * mask.sum()) else mask


def _half_plane(mask: Bool[np.ndarray, "size size"], rng: np.random.Generator) -> Bool[np.ndarray, "size size"]:
    """Return one side of a line that leaves between 60 and 95 % of the mask."""
    rows, columns = np.nonzero(mask)
    angle = rng.uniform(0, 2 * np.pi)
    normal = np.array([np.cos(angle), np.sin(angle)])
    limit = np.quantile(columns * normal[0] + rows * normal[1], rng.uniform(0.6, 0.95))
    y, x = np.mgrid[: mask.shape[0], : mask.shape[1]]
    return x * normal[0] + y * normal[1] <= limit


def jitter_boxes(
    boxes_xyxy_px: Float[np.ndarray, "n 4"], config: AugmentationConfig, rng: np.random.Generator
) -> Float[np.ndarray, "n 4"]:
    """Return the boxes with random shifts and scales."""
    centre, size = (boxes_xyxy_px[:, :2] + boxes_xyxy_px[:, 2:]) / 2, boxes_xyxy_px[:, 2:] - boxes_xyxy_px[:, :2]
    side = size.max(axis=1, keepdims=True)
    centre = centre + rng.normal(0, config.box_jitter, centre.shape) * side
    size = size * np.exp(rng.normal(0, config.box_jitter, (len(size), 1)))
    return np.concatenate([centre - size / 2, centre + size / 2], axis=1)
