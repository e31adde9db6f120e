"""Gaussian blur of many small maps at once, as products with two banded matrices."""

from __future__ import annotations

from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor


def blur(
    maps: Float[Tensor, "*batch size size"], deviation_px: float, stride: int = 1
) -> Float[Tensor, "*batch coarse coarse"]:
    """Return square maps convolved with a Gaussian, zero beyond their borders, at the centres of blocks of pixels.

    Blocks are `stride` pixels wide: what is blurred has no finer detail, and every map after it has fewer pixels.
    """
    size = maps.shape[-1]
    B = _blur_matrix(size, deviation_px, stride)
    coarse = len(B)
    # Two large products, because many small ones are several times slower.
    along_rows = (maps.reshape(-1, size) @ B.T).reshape(-1, size, coarse).transpose(1, 2)
    blurred = (along_rows.reshape(-1, size) @ B.T).reshape(-1, coarse, coarse).transpose(1, 2)
    return blurred.reshape(*maps.shape[:-2], coarse, coarse)


def central_differences(
    maps: Float[Tensor, "*batch size size"],
) -> tuple[Float[Tensor, "*batch size size"], Float[Tensor, "*batch size size"]]:
    """Return the derivatives along x (columns) and y (rows) per pixel; zero on the border."""
    dx, dy = torch.zeros_like(maps), torch.zeros_like(maps)
    dx[..., 1:-1] = (maps[..., 2:] - maps[..., :-2]) / 2
    dy[..., 1:-1, :] = (maps[..., 2:, :] - maps[..., :-2, :]) / 2
    return dx, dy


@lru_cache(maxsize=32)
def _blur_matrix(size: int, deviation_px: float, stride: int) -> Float[Tensor, "coarse size"]:
    centres = stride * torch.arange(size // stride, dtype=torch.float64) + (stride - 1) / 2
    apart = centres[:, None] - torch.arange(size, dtype=torch.float64)
    B = torch.exp(-0.5 * (apart / deviation_px) ** 2)
    # Rows in the middle sum to 1, those at the border to less: what lies beyond counts as zero.
    return (B / B[len(B) // 2].sum()).float()
