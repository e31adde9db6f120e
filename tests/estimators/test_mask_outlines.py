"""Outlines follow the image where it contradicts them, and stay where it does not."""

from __future__ import annotations

import numpy as np

from simpick.estimators.detection_noise import ragged
from simpick.estimators.mask_outlines import on_image_edges


def disc() -> tuple[np.ndarray, np.ndarray]:
    """Return a bright disc before a dark background, and its mask."""
    y, x = np.mgrid[:80, :90] + 0.5
    mask = (x - 44) ** 2 + (y - 41) ** 2 < 24**2
    return np.where(mask[..., None], 190, 60).astype(np.uint8).repeat(3, axis=2), mask


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def test_a_ragged_outline_moves_to_the_edge():
    rgb, mask = disc()
    rough = ragged(mask, 1.5, np.random.default_rng(0))
    assert overlap(rough, mask) < 0.92
    assert overlap(on_image_edges(rgb, rough), mask) > 0.98


def test_an_outline_on_the_edge_is_kept():
    rgb, mask = disc()
    noisy = np.clip(rgb + np.random.default_rng(0).normal(0, 8, rgb.shape), 0, 255).astype(np.uint8)
    assert on_image_edges(noisy, mask) is mask


def test_without_edges_nothing_moves():
    _, mask = disc()
    assert on_image_edges(np.full((80, 90, 3), 120, np.uint8), mask) is mask
    empty = np.zeros_like(mask)
    assert on_image_edges(np.zeros((80, 90, 3), np.uint8), empty) is empty


def test_a_mask_at_the_image_border_is_no_problem():
    rgb, mask = disc()
    corner = on_image_edges(rgb[30:, 40:], ragged(mask, 1.5, np.random.default_rng(1))[30:, 40:])
    assert overlap(corner, mask[30:, 40:]) > 0.95
