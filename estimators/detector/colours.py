"""Colours as evidence of names: how well the colour of each instance agrees with that of each part's CAD.

Colours on CAD files are often wrong, and light changes them. So what is typical of this image is measured first: the
shift between the colours of CAD and image, and the deviation that remains. Where colours do not agree with the names
that shapes suggest, the deviation is large, and colours count for nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.special import softmax

from simpick.assets.part import Part
from simpick.geometry import window_of_mask

_LOG_ODDS_PER_SIMILARITY = 30.0
_ROUNDS = 2
# Of CIELAB's lightness, a and b: shading changes lightness most.
_WEIGHTS = np.array([0.4, 1.0, 1.0])
_LEAST_DEVIATION = 5.0
_FLOOR = 0.02
"""Agreement of colours that have nothing in common."""
_SURE, _FEWEST = 0.6, 3
_SMALLEST_PX = 20


def colour_evidence(
    similarity: Float[np.ndarray, "instances parts"],
    scores: Float[np.ndarray, "instances"],
    colours: Float[np.ndarray, "instances 3"],
    part_colours: Float[np.ndarray, "parts 3"],
) -> Float[np.ndarray, "instances parts"]:
    """Return what to add to the similarities of instances and parts for the agreement of their colours.

    Parts whose colours agree equally well get the same. `scores` are the probabilities of the masks.
    """
    evidence = np.zeros(similarity.shape)
    for _ in range(_ROUNDS if len(similarity) else 0):
        names = softmax(_LOG_ODDS_PER_SIMILARITY * (similarity + evidence), axis=1)
        best, sureness = names.argmax(axis=1), names.max(axis=1) * scores
        is_sure = sureness >= min(_SURE, np.sort(sureness)[-min(_FEWEST, len(sureness))])
        shift = np.median((colours - part_colours[best])[is_sure], axis=0)
        squared = ((_WEIGHTS * (colours[:, None] - part_colours - shift)) ** 2).sum(axis=2)
        typical = np.median(np.sqrt(squared[np.arange(len(best)), best])[is_sure])
        agreement = np.exp(-squared / (2 * max(_LEAST_DEVIATION, float(typical)) ** 2)) + _FLOOR
        evidence = np.log(agreement / agreement.mean(axis=1, keepdims=True)) / _LOG_ODDS_PER_SIMILARITY
    return evidence


def instance_colours(
    rgb: UInt8[np.ndarray, "height width 3"], masks: Sequence[Bool[np.ndarray, "height width"]]
) -> Float[np.ndarray, "instances 3"]:
    """Return the median colour (CIELAB) of each mask, without its border as far as it is large enough."""
    lab = cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    kernel = np.ones((3, 3), np.uint8)
    colours = np.zeros((len(masks), 3))
    for colour, mask in zip(colours, masks, strict=True):
        window = window_of_mask(mask, 1)
        inner = cv2.erode(mask[window].astype(np.uint8), kernel) > 0
        colour[:] = np.median(lab[window][inner if inner.sum() >= _SMALLEST_PX else mask[window]], axis=0)
    return colours


def cad_colours(parts: Sequence[Part]) -> Float[np.ndarray, "parts 3"]:
    """Return the colour (CIELAB) of each part's material."""
    rgb = np.array([part.material.rgb for part in parts], np.float32).reshape(1, -1, 3)
    return cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB)[0].astype(float)
