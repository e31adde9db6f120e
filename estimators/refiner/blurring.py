"""Gaussian blur of many small maps: averages over blocks of pixels, then products with two matrices."""

from __future__ import annotations

from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

_LEAST_DEVIATION_BLOCKS = 0.3
"""Minimum, in blocks. A narrower Gaussian has no effect, but its matrix would be ill-defined."""
_LEAST_WEIGHT = 1e-9
"""Relative to the middle's. Smaller weights change no sum in single precision."""


def blur(
    maps: Float[Tensor, "*batch size size"], deviation_px: float, stride: int = 1
) -> Float[Tensor, "*batch coarse coarse"]:
    """Return square maps convolved with a Gaussian, zero beyond their borders, at the centres of blocks of pixels.

    Blocks are `stride` pixels wide: blurred maps have no finer detail. The kernel is the block's box and a Gaussian
    over blocks, whose variances add up to `deviation_px` squared, so the matrices are as small as the results.
    """
    blocks = _block_means(maps, stride)
    coarse = blocks.shape[-1]
    box_variance = (stride**2 - 1) / 12
    deviation_blocks = max(deviation_px**2 - box_variance, 0.0) ** 0.5 / stride
    B = _blur_matrix(coarse, max(deviation_blocks, _LEAST_DEVIATION_BLOCKS))
    # Two large products are several times faster than many small ones.
    along_rows = (blocks.reshape(-1, coarse) @ B.T).reshape(-1, coarse, coarse).transpose(1, 2)
    blurred = (along_rows.reshape(-1, coarse) @ B.T).reshape(-1, coarse, coarse).transpose(1, 2)
    return blurred.reshape(*maps.shape[:-2], coarse, coarse)


def central_differences(
    maps: Float[Tensor, "*batch size size"],
) -> tuple[Float[Tensor, "*batch size size"], Float[Tensor, "*batch size size"]]:
    """Return the derivatives along x (columns) and y (rows) per pixel; zero on the border."""
    dx, dy = torch.zeros_like(maps), torch.zeros_like(maps)
    dx[..., 1:-1] = (maps[..., 2:] - maps[..., :-2]) / 2
    dy[..., 1:-1, :] = (maps[..., 2:, :] - maps[..., :-2, :]) / 2
    return dx, dy


def eroded(maps: Float[Tensor, "*batch size size"]) -> Float[Tensor, "*batch size size"]:
    """Return the minimum over each pixel and its eight neighbours; pixels beyond the border do not count."""
    # Slices along rows, then columns: several times faster than torch's pooling.
    rows = maps.clone()
    torch.minimum(maps[..., 1:, :], maps[..., :-1, :], out=rows[..., 1:, :])
    rows[..., :-1, :] = torch.minimum(rows[..., :-1, :], maps[..., 1:, :])
    both = rows.clone()
    both[..., 1:] = torch.minimum(rows[..., 1:], rows[..., :-1])
    both[..., :-1] = torch.minimum(both[..., :-1], rows[..., 1:])
    return both


def _block_means(maps: Float[Tensor, "*batch size size"], stride: int) -> Float[Tensor, "*batch coarse coarse"]:
    # Sums of slices are several times faster than torch's pooling.
    if stride == 1:
        return maps
    rows = sum(maps[..., k::stride, :] for k in range(1, stride)) + maps[..., ::stride, :]
    return (sum(rows[..., k::stride] for k in range(1, stride)) + rows[..., ::stride]) / stride**2


@lru_cache(maxsize=32)
def _blur_matrix(size: int, deviation: float) -> Float[Tensor, "size size"]:
    positions = torch.arange(size, dtype=torch.float64)
    B = torch.exp(-0.5 * ((positions[:, None] - positions) / deviation) ** 2)
    # Values far away would be denormal in single precision, with which products take many times as long.
    B[B < _LEAST_WEIGHT] = 0.0
    # Rows in the middle sum to 1, those at the border to less, since pixels beyond it count as zero.
    return (B / B[size // 2].sum()).float()
