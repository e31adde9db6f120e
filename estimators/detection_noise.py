"""Errors of detections: missed and merged instances, ragged masks, inaccurate boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Interval
from jaxtyping import Bool, Float, Int

from simpick.config import Config, Fraction
from simpick.errors import UnknownNameError

_GROWN_BOX_PX = 8
"""Margin around a mask for its ragged outline."""


@dataclass(frozen=True)
class DetectionNoise(Config):
    """Kinds of errors, with their rates and sizes; none by default."""

    miss: Fraction = 0.0
    """Probability that an instance is not detected."""
    merge: Fraction = 0.0
    """Probability that an instance's mask includes the instance it touches most, which is then not detected itself."""
    ragged_px: Annotated[float, Interval(ge=0, le=_GROWN_BOX_PX / 2)] = 0.0
    """Standard deviation of the mask's outline, inwards and outwards, in pixels."""
    box_jitter: Annotated[float, Interval(ge=0, le=0.25)] = 0.0
    """Standard deviation of each edge of the box, as a fraction of the box's side."""
    masks: bool = True
    """Whether detections have masks; without, a box is all that an estimator gets."""


DETECTION_PRESETS = {
    "perfect": DetectionNoise(),
    "realistic": DetectionNoise(miss=0.05, merge=0.05, ragged_px=1.5, box_jitter=0.03),
    "box": DetectionNoise(masks=False),
}
"""Named presets; every reported figure names the one it used."""


def detection_noise(preset: str) -> DetectionNoise:
    """Return a preset by name; raises UnknownNameError."""
    if preset not in DETECTION_PRESETS:
        raise UnknownNameError("detection preset", preset, DETECTION_PRESETS)
    return DETECTION_PRESETS[preset]


def miss_and_merge(
    instances: Int[np.ndarray, "height width"],
    found: Int[np.ndarray, "n"],
    noise: DetectionNoise,
    rng: np.random.Generator,
) -> dict[int, tuple[int, ...]]:
    """Return the instances that each detection's mask covers, its own first, by the detection's instance.

    Always draws two numbers per instance of `found`, so that changing one probability does not affect the other draw.
    """
    chances = rng.random((len(found), 2))
    covers: dict[int, tuple[int, ...]] = {int(k): (int(k),) for k in found}
    absorbed: set[int] = set()
    for k, (_, merge) in zip(found.tolist(), chances, strict=True):
        if merge < noise.merge and k not in absorbed:
            neighbour = _touched_most(instances, k, absorbed | {j for j, c in covers.items() if len(c) > 1})
            if neighbour is not None:
                covers[k] += (neighbour,)
                absorbed.add(neighbour)
    missed = {k for k, (miss, _) in zip(found.tolist(), chances, strict=True) if miss < noise.miss}
    return {k: c for k, c in covers.items() if k not in absorbed and k not in missed}


def _touched_most(instances: Int[np.ndarray, "height width"], instance: int, excluded: set[int]) -> int | None:
    mask = (instances == instance).astype(np.uint8)
    rim = cv2.dilate(mask, np.ones((5, 5), np.uint8)).astype(bool) & ~mask.astype(bool)
    ids, counts = np.unique(instances[rim], return_counts=True)
    free = np.array([k >= 0 and k not in excluded for k in ids.tolist()], bool)
    if not free.any():
        return None
    return int(ids[free][np.argmax(counts[free])])


def ragged(
    mask: Bool[np.ndarray, "height width"], deviation_px: float, rng: np.random.Generator
) -> Bool[np.ndarray, "height width"]:
    """Return the mask with its outlines, those of holes too, moved in and out by a smooth random field."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if deviation_px == 0 or len(rows) == 0:
        return mask
    top, left = max(rows[0] - _GROWN_BOX_PX, 0), max(columns[0] - _GROWN_BOX_PX, 0)
    window = mask[top : rows[-1] + 1 + _GROWN_BOX_PX, left : columns[-1] + 1 + _GROWN_BOX_PX]
    inside = np.pad(window, 1).astype(np.uint8)
    # Pixels along the outline are half a pixel from it on either side, and OpenCV counts to the next pixel's centre.
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, 5) - cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5)
    distance = depth - np.sign(depth) / 2
    field = cv2.GaussianBlur(rng.normal(size=window.shape).astype(np.float32), (0, 0), 3.0)
    field *= deviation_px / max(float(field.std()), 1e-6)
    moved = np.zeros_like(mask)
    moved[top : top + window.shape[0], left : left + window.shape[1]] = distance[1:-1, 1:-1] + field > 0
    return moved


def jittered_box(
    box_xyxy_px: Float[np.ndarray, "4"], deviation: float, rng: np.random.Generator, width: int, height: int
) -> Float[np.ndarray, "4"]:
    """Return the box with its edges moved, still within the image and at least a pixel wide and high."""
    sides = np.tile(box_xyxy_px[2:] - box_xyxy_px[:2], 2)
    box = box_xyxy_px + deviation * sides * rng.normal(size=4)
    low = np.clip(box[:2], 0, [width - 1, height - 1])
    return np.concatenate([low, np.clip(np.maximum(box[2:], low + 1), 1, [width, height])])
