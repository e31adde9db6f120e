"""Crops of many images at once, cut on the device that holds the images: what `crops.cut_crop` cuts one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.detector.affinities import STRIDE
from simpick.training.detector.crop_plans import ANY_PART, CropPlan


def cut_crops(
    rgb: UInt8[Tensor, "batch 3 height width"],
    ids: UInt8[Tensor, "batch height width"],
    blanks: UInt8[Tensor, "batch 3"],
    plans: Sequence[CropPlan],
    size_px: int,
) -> tuple[Float[Tensor, "batch 3 size size"], UInt8[Tensor, "batch cells cells"]]:
    """Return one planned crop of each image, in whole grey levels, and the instances in its cells.

    What lies outside of an image has the colour `blanks`. Exposure and compression of the plans are not applied.
    """
    height, width = ids.shape[1:]
    inverse = np.linalg.inv(np.stack([plan.linear for plan in plans]))
    target = np.stack([plan.target_px for plan in plans])
    linear = torch.from_numpy(inverse).to(ids.device, torch.float32)
    origin = torch.from_numpy(-np.einsum("bij,bj->bi", inverse, target)).to(ids.device, torch.float32)
    origin = origin + _aims(ids, plans)

    def sampled(images: Float[Tensor, "batch n height width"], first: float, step: int, mode: str) -> Tensor:
        """Return the images at `first`, `first + step` and so on in the crop, along both axes."""
        points = torch.arange(first, size_px, step, device=ids.device, dtype=torch.float32)
        # No matrix product: where those round to TF32, places in the image would be wrong by a third of a pixel.
        places = (
            linear[:, None, None, :, 0] * points[None, None, :, None]
            + linear[:, None, None, :, 1] * points[None, :, None, None]
            + origin[:, None, None]
        )
        places = places * places.new_tensor([2 / (width - 1), 2 / (height - 1)]) - 1
        return F.grid_sample(images, places, mode, padding_mode="zeros", align_corners=True)

    blank = blanks.float()[:, :, None, None]
    # Cells' middles lie between pixels, see `cut_crop`.
    cells = sampled(ids[:, None].float(), 0.5, STRIDE, "nearest")[:, 0]
    return (sampled(rgb.float() - blank, 0.0, 1, "bilinear") + blank).round(), cells.to(torch.uint8)


def _aims(ids: UInt8[Tensor, "batch height width"], plans: Sequence[CropPlan]) -> Float[Tensor, "batch 2"]:
    """Return the pixels, x and y, that the plans place crops by."""
    instances = torch.tensor([[plan.instance] for plan in plans], dtype=torch.int16, device=ids.device)
    numbers = torch.tensor([[plan.pixel + 1] for plan in plans], dtype=torch.int32, device=ids.device)
    flat = ids.flatten(1)
    is_instance = torch.where(instances == ANY_PART, flat > 0, flat == instances)
    places = torch.searchsorted(is_instance.cumsum(1, dtype=torch.int32), numbers)
    width = ids.shape[2]
    return torch.cat([places % width, places // width], 1).float()
