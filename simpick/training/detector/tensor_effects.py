"""Camera effects on many images at once, on their device: what `camera_effects` does to one image."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float, Float32, UInt8
from torch import Tensor
from torch.nn import functional as F

from simpick.rendering.camera_effects import Exposure
from simpick.rendering.luminance import LUMINANCE
from simpick.training.detector.tensor_jpeg import compress_jpegs

Images = Float32[Tensor, "batch 3 height width"]


def apply_tensor_effects(
    rgb: Images, exposures: Sequence[Exposure], jpeg_qualities: Sequence[int | None], generator: torch.Generator
) -> UInt8[Tensor, "batch 3 height width"]:
    """Return images in grey levels with the effects of each; the generator, of their device, draws the noise.

    Height and width are multiples of 16.
    """
    x = (rgb / 255) ** _column(rgb, [e.gamma for e in exposures])
    x = _coloured(x, exposures)
    middle = x.mean((1, 2, 3), keepdim=True)
    x = middle + _column(x, [e.contrast for e in exposures]) * (x - middle)
    x = x * _column(x, [e.brightness for e in exposures])
    corners = [None if e.corners is None else e.corners.tolist() for e in exposures]
    x = _changed(x, corners, _lit)
    x = _changed(x, [e.blur_px for e in exposures], _blurred)

    def noisy(x: Images, sigmas: Float[Tensor, "batch"]) -> Images:
        return x + sigmas[:, None, None, None] * torch.randn(x.shape, generator=generator, device=x.device)

    x = _changed(x, [e.noise for e in exposures], noisy)
    x = (255 * x).clamp(0, 255).floor()
    return _changed(x, jpeg_qualities, compress_jpegs).to(torch.uint8)


def _column(x: Images, values: Sequence[float]) -> Float[Tensor, "batch 1 1 1"]:
    return torch.tensor(values, dtype=x.dtype, device=x.device)[:, None, None, None]


def _changed(x: Images, values: Sequence[object | None], change: Callable[[Tensor, Tensor], Tensor]) -> Images:
    """Return the images, changed by its value where that is not None."""
    chosen = [k for k, value in enumerate(values) if value is not None]
    if not chosen:
        return x
    rows = torch.tensor(chosen, device=x.device)
    return x.index_copy(0, rows, change(x[rows], torch.tensor([values[k] for k in chosen], device=x.device)))


def _coloured(x: Images, exposures: Sequence[Exposure]) -> Images:
    """Return the images with other saturations and gains, or without colour: sums of shares of their channels."""
    shares = torch.tensor(LUMINANCE).expand(len(x), 3, 3).clone()
    for k, exposure in enumerate(exposures):
        if exposure.saturation is not None and exposure.gains is not None:
            mixed = exposure.saturation * torch.eye(3) + (1 - exposure.saturation) / 3
            shares[k] = torch.from_numpy(exposure.gains)[:, None] * mixed
    return (shares.to(x.device) @ x.flatten(2)).view_as(x)


def _lit(x: Images, corners: Float[Tensor, "batch 2 2"]) -> Images:
    return x * F.interpolate(corners[:, None], size=x.shape[2:], mode="bilinear", align_corners=False)


def _blurred(x: Images, sigmas_px: Float[Tensor, "batch"]) -> Images:
    """Return the images after Gaussian blurs that end at four standard deviations of the largest one."""
    radius = min(int(4 * float(sigmas_px.max()) + 0.5), min(x.shape[2:]) - 1)
    k = torch.arange(-radius, radius + 1, device=x.device)
    weights = torch.exp(-0.5 * (k / sigmas_px[:, None]) ** 2)
    weights = (weights / weights.sum(1, keepdim=True)).repeat_interleave(3, 0)[:, None]
    # All channels of all images as channels of one image, each with a filter of its own.
    planes = F.pad(x, (radius,) * 4, mode="reflect").flatten(0, 1)[None]
    planes = F.conv2d(planes, weights[..., None], groups=len(weights))
    return F.conv2d(planes, weights[:, :, None], groups=len(weights)).view_as(x)
