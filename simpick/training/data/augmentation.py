"""Augmentation of queries: masks as wrong as detectors' are, and inexact boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Interval
from jaxtyping import Bool, Float, UInt8

from simpick.config import Config, Fraction
from simpick.training.data.shard import OWN

_SMALLEST_PX = 30
_LEAST_LEFT = 0.3
"""Share of a mask that is left at least."""


@dataclass(frozen=True)
class AugmentationConfig(Config):
    """How strongly queries are changed. The shares of errors are of all queries; a mask can have several errors."""

    turn: bool = True
    """Rotate each query about the optical axis by a random angle."""
    box_jitter: Annotated[float, Interval(ge=0, lt=1)] = 0.03
    """Standard deviation of a box's shift and relative size, as a share of its longer side."""
    box_share: Fraction = 0.12
    """Share of queries whose mask is their whole box, as of detections without masks."""
    merged_share: Fraction = 0.12
    """Share of masks that a neighbour, or a piece of it, is joined to."""
    hidden_share: Fraction = 0.25
    """Share of masks of which a straight cut hides a part."""
    hole_share: Fraction = 0.1
    """Share of masks that lack a round piece."""
    ragged_share: Fraction = 0.5
    """Share of masks whose outline is wrong by some pixels, unevenly, or that are grown or shrunk."""
    brightness: Annotated[float, Interval(ge=0, lt=1)] = 0.25
    """Largest relative change of brightness."""


def perturb_mask(
    labels: UInt8[np.ndarray, "size size"], config: AugmentationConfig, rng: np.random.Generator
) -> Bool[np.ndarray, "size size"]:
    """Return the mask as a detector might find it; unchanged where too few pixels would be left."""
    mask = labels == OWN
    if rng.random() < config.box_share:
        return _box(mask)
    out = mask
    if rng.random() < config.merged_share:
        out = out | _neighbour(labels, rng)
    if rng.random() < config.hidden_share:
        out = out & _half_plane(mask, rng)
    if rng.random() < config.hole_share:
        out = out & ~_disc(mask, rng)
    if rng.random() < config.ragged_share:
        out = _wrong_outline(out, rng)
    own = np.count_nonzero(out & mask)
    return out if own >= max(_SMALLEST_PX, _LEAST_LEFT * np.count_nonzero(mask)) else mask


def _box(mask: Bool[np.ndarray, "size size"]) -> Bool[np.ndarray, "size size"]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    out = np.zeros_like(mask)
    out[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = True
    return out


def _neighbour(labels: UInt8[np.ndarray, "size size"], rng: np.random.Generator) -> Bool[np.ndarray, "size size"]:
    """Return an instance that touches the own one: all of it, or what lies nearby; nothing if there is none."""
    mask = labels == OWN
    around = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    touching = np.unique(labels[around & (labels > OWN)])
    if not len(touching):
        return np.zeros_like(mask)
    neighbour = labels == rng.choice(touching)
    if rng.random() < 0.5:
        reach = rng.uniform(0.05, 0.3) * np.sqrt(np.count_nonzero(mask))
        distance = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
        neighbour &= distance < reach
    return neighbour


def _half_plane(mask: Bool[np.ndarray, "size size"], rng: np.random.Generator) -> Bool[np.ndarray, "size size"]:
    """Return one side of a line that leaves between 50 and 95 % of the mask."""
    rows, columns = np.nonzero(mask)
    angle = rng.uniform(0, 2 * np.pi)
    normal = np.array([np.cos(angle), np.sin(angle)])
    limit = np.quantile(columns * normal[0] + rows * normal[1], rng.uniform(0.5, 0.95))
    y, x = np.ogrid[: mask.shape[0], : mask.shape[1]]
    return x * normal[0] + y * normal[1] <= limit


def _disc(mask: Bool[np.ndarray, "size size"], rng: np.random.Generator) -> Bool[np.ndarray, "size size"]:
    rows, columns = np.nonzero(mask)
    k = rng.integers(len(rows))
    radius = rng.uniform(0.1, 0.35) * np.sqrt(len(rows))
    y, x = np.ogrid[: mask.shape[0], : mask.shape[1]]
    return (x - columns[k]) ** 2 + (y - rows[k]) ** 2 < radius**2


def _wrong_outline(mask: Bool[np.ndarray, "size size"], rng: np.random.Generator) -> Bool[np.ndarray, "size size"]:
    """Return the mask with its outline moved in or out by a smooth random distance, uniform or uneven."""
    size = mask.shape[0]
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3)
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
    amplitude = rng.uniform(0.5, 4.0) * size / 160
    cells = int(rng.integers(4, 24))
    field = cv2.resize(rng.normal(0, 1, (cells, cells)).astype(np.float32), (size, size), interpolation=cv2.INTER_CUBIC)
    return inside - outside > amplitude * (0.6 * rng.normal() + 0.8 * field)


def jitter_boxes(
    boxes_xyxy_px: Float[np.ndarray, "n 4"], config: AugmentationConfig, rng: np.random.Generator
) -> Float[np.ndarray, "n 4"]:
    """Return the boxes with random shifts and scales."""
    centre, size = (boxes_xyxy_px[:, :2] + boxes_xyxy_px[:, 2:]) / 2, boxes_xyxy_px[:, 2:] - boxes_xyxy_px[:, :2]
    side = size.max(axis=1, keepdims=True)
    centre = centre + rng.normal(0, config.box_jitter, centre.shape) * side
    size = size * np.exp(rng.normal(0, config.box_jitter, (len(size), 1)))
    return np.concatenate([centre - size / 2, centre + size / 2], axis=1)
