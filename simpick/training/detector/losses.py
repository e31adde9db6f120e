"""The detector's losses, one function per map."""

from __future__ import annotations

import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.detector.affinities import OFFSETS, pair_windows
from simpick.estimators.detector.network import CellMaps
from simpick.training.detector.batches import CropBatch
from simpick.training.detector.config import LossWeights

_TYPICAL_CELLS = 400.0


def loss_terms(maps: CellMaps, batch: CropBatch) -> dict[str, Float[Tensor, ""]]:
    """Return the terms of the loss by the names of `LossWeights`."""
    weights = cell_weights(batch.ids)
    is_part = (batch.ids > 0).float()
    return {
        "foreground": F.binary_cross_entropy_with_logits(maps.foreground.float(), is_part),
        "affinity": affinity_loss(maps.affinities.float(), batch.ids, weights),
    }


def weighted_sum(terms: dict[str, Float[Tensor, ""]], weights: LossWeights) -> Float[Tensor, ""]:
    """Return the loss."""
    return torch.stack([getattr(weights, name) * value for name, value in terms.items()]).sum()


def cell_weights(ids: UInt8[Tensor, "n h w"]) -> Float[Tensor, "n h w"]:
    """Return weights by which small instances count more than their cells do, and 0 in the background."""
    n = len(ids)
    keys = ids.long() + 256 * torch.arange(n, device=ids.device)[:, None, None]
    areas = torch.bincount(keys.flatten(), minlength=256 * n).float()
    weights = (_TYPICAL_CELLS / areas.clamp_min(1)).sqrt().clamp(0.5, 3.0)[keys]
    return weights * (ids > 0)


def affinity_loss(
    logits: Float[Tensor, "n offsets h w"], ids: UInt8[Tensor, "n h w"], weights: Float[Tensor, "n h w"]
) -> Float[Tensor, ""]:
    """Return the mean cross-entropy of pairs whose first cell shows a part and whose second lies in the crop."""
    height, width = ids.shape[1:]
    total, count = logits.new_zeros(()), logits.new_zeros(())
    for k, offset in enumerate(OFFSETS):
        here, there = ((slice(None), *window) for window in pair_windows(height, width, offset))
        first, second = ids[here], ids[there]
        # Either end may be the part: a pair is seen from both sides.
        weight = torch.maximum(weights[here], weights[there])
        same = ((first == second) & (first > 0)).float()
        losses = F.binary_cross_entropy_with_logits(logits[:, k][here], same, reduction="none")
        total = total + (losses * weight).sum()
        count = count + weight.sum()
    return total / count.clamp_min(1)
