"""One vector per view: similar for similar views of the same part, different for other views and other parts.

Not in the paper. A query is compared with thousands of views of a part by one product, which gives first poses.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

_CELLS, _CHANNELS, _WIDTH = 6, 32, 128


class ViewEmbedding(nn.Module):
    """Embeds the image features with their layout: what lies where, not only what there is."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.project = nn.Conv2d(inputs, _CHANNELS, 1)
        self.embed = nn.Sequential(
            nn.Linear(_CELLS * _CELLS * _CHANNELS, 2 * _WIDTH), nn.GELU(), nn.Linear(2 * _WIDTH, _WIDTH)
        )
        self.log_temperature = nn.Parameter(torch.tensor(math.log(15.0)))

    def forward(self, features: Float[Tensor, "batch inputs h w"]) -> Float[Tensor, "batch embedding"]:
        """Return vectors of unit length."""
        x = F.adaptive_avg_pool2d(F.relu(self.project(features)), _CELLS)
        return F.normalize(self.embed(x.flatten(1)).float(), dim=-1)

    def logits(
        self, query: Float[Tensor, "queries embedding"], views: Float[Tensor, "views embedding"]
    ) -> Float[Tensor, "queries views"]:
        """Return the logarithms, but for a constant per query, of the probabilities that a query shows these views."""
        with torch.autocast(query.device.type, enabled=False):
            return query.float() @ views.float().mT * self.log_temperature.exp().clamp(max=100.0)
