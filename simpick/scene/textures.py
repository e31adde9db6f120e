"""Procedural images for floor and bin: no files, everything from a generator."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8


def value_noise(rng: np.random.Generator, size_px: int, octaves: int = 5) -> Float[np.ndarray, "size size"]:
    """Return smooth noise in [0, 1] that tiles: random grids of doubling fineness, each half as strong, summed.

    `size_px` must be a multiple of ``2 ** (octaves + 1)``.
    """
    noise = np.zeros((size_px, size_px))
    for octave in range(octaves):
        cells = 2 ** (octave + 2)
        scale = size_px // cells
        # Continued past all edges before it is made finer, so that the texture tiles without seams.
        grid = np.pad(rng.uniform(size=(cells, cells)).astype(np.float32), 2, mode="wrap")
        fine = cv2.resize(grid, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        noise += 0.5**octave * fine[2 * scale : -2 * scale, 2 * scale : -2 * scale]
    return (noise - noise.min()) / (noise.max() - noise.min())


def mottled(
    rng: np.random.Generator, rgb: Float[np.ndarray, "3"], contrast: float, size_px: int = 256
) -> UInt8[np.ndarray, "size size 3"]:
    """Return a surface of one colour with soft stains; `contrast` is the relative change of brightness."""
    noise = value_noise(rng, size_px) - 0.5
    grain = rng.normal(scale=0.05, size=(size_px, size_px))
    image = rgb * (1 + contrast * (2 * noise + grain))[..., None]
    return (255 * np.clip(image, 0, 1)).astype(np.uint8)


def brushed(
    rng: np.random.Generator, rgb: Float[np.ndarray, "3"], contrast: float, size_px: int = 256
) -> UInt8[np.ndarray, "size size 3"]:
    """Return a surface scratched along one direction, like brushed metal or wood grain."""
    lines = rng.normal(size=(size_px, size_px)).astype(np.float32)
    lines = cv2.blur(lines, (max(size_px // 6, 3), 1), borderType=cv2.BORDER_REFLECT)
    lines /= np.abs(lines).max()
    image = rgb * (1 + contrast * lines)[..., None]
    return (255 * np.clip(image, 0, 1)).astype(np.uint8)


def checkered(
    rng: np.random.Generator, rgb: Float[np.ndarray, "3"], contrast: float, size_px: int = 256
) -> UInt8[np.ndarray, "size size 3"]:
    """Return tiles of two shades, 4 to 16 of them a side."""
    tiles = int(2 ** rng.integers(2, 5))
    index = np.arange(size_px) * tiles // size_px
    sign = np.where((index[:, None] + index[None]) % 2 == 0, 1.0, -1.0)
    image = rgb * (1 + contrast * sign)[..., None]
    return (255 * np.clip(image, 0, 1)).astype(np.uint8)


PATTERNS = {"mottled": mottled, "brushed": brushed, "checkered": checkered}
"""Every pattern by its name."""
