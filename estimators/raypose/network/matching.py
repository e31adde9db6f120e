"""Matching: for each cell of the query, the point of the part that the templates' descriptors assign to it.

Not in the paper. Cross-attention can learn this too, but needs millions of samples to begin; descriptors with a
contrastive loss learn from the start, and the surface points that a rendered template shows are known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.tensor_record import TensorRecord

MIN_COVERAGE = 0.3
"""Template cells that the part covers less are not matched."""
_NEVER = -1e4
"""Logit of such cells."""
FEATURES = 11
"""Of `Matches.features`."""


@dataclass(frozen=True, eq=False)
class Matches(TensorRecord):
    """What each query cell matched among the cells of all templates."""

    logits: Float[Tensor, "batch query_cells template_cells"]
    """Of template cells (all templates, one after the other), for each query cell."""
    points: Float[Tensor, "batch query_cells 3"]
    """Expected position in the part's frame, in diameters."""
    spread: Float[Tensor, "batch query_cells"]
    """Standard deviation of that position, in diameters."""
    similarity: Float[Tensor, "batch query_cells"]
    """Cosine of the most similar descriptor."""
    weights: Float[Tensor, "batch query_cells"]
    """Learned trust in each cell's match, in [0, 1]."""

    @property
    def log_probabilities(self) -> Float[Tensor, "batch query_cells template_cells"]:
        """Return the logarithms of the template cells' probabilities, for each query cell."""
        return self.logits.log_softmax(dim=-1)

    def features(
        self,
        residuals: Float[Tensor, "batch views query_cells 2"],
        reference: ViewPoses,
        scale: Float[Tensor, "batch views"],
        coverage: Float[Tensor, "batch query_cells"],
        pixel_centroids: Float[Tensor, "batch query_cells 2"],
    ) -> Float[Tensor, "batch views query_cells 11"]:
        """Return the decoder's input for each cell and view.

        The matched point in the reference view (3), its residual in the initial pose (2), spread, similarity, weight,
        coverage, and the centroid of the cell's pixels (2). `scale` is the part's diameter over the reference view's
        half extent.
        """
        matched = torch.einsum("bkij,bnj->bkni", reference.R, self.points) * scale[..., None, None]
        own = torch.stack([self.spread * 4, self.similarity, self.weights, coverage], dim=-1)  # (batch, cells, 4)
        shared = torch.cat([own, pixel_centroids], dim=-1)[:, None].expand(-1, matched.shape[1], -1, -1)
        return torch.cat([matched, 4 * residuals, shared], dim=-1)


class Matcher(nn.Module):
    """Descriptors of unit length and a learned temperature."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        self.project = nn.Conv2d(inputs, width, 1)
        self.log_temperature = nn.Parameter(torch.tensor(math.log(25.0)))
        self.trust = nn.Sequential(nn.Linear(width + 3, 32), nn.ReLU(), nn.Linear(32, 1))

    def describe(self, features: Float[Tensor, "batch inputs h w"]) -> Float[Tensor, "batch cells width"]:
        """Return one descriptor per cell, row by row."""
        return F.normalize(self.project(features).flatten(2).mT, dim=-1)

    def match(
        self,
        query: Float[Tensor, "batch query_cells width"],
        templates: Float[Tensor, "batch template_cells width"],
        points: Float[Tensor, "batch template_cells 3"],
        coverage: Float[Tensor, "batch template_cells"],
        query_coverage: Float[Tensor, "batch query_cells"],
    ) -> Matches:
        """Return what each query cell matches among all template cells; positions in diameters of the part."""
        covered = (coverage >= MIN_COVERAGE)[:, None]  # (batch, 1, template cells)
        scale = self.log_temperature.exp().clamp(max=100.0)
        logits = (query * scale) @ templates.mT
        logits = logits.masked_fill(~covered, _NEVER)  # (batch, query cells, template cells)
        moments = torch.cat([points, points.square().sum(dim=-1, keepdim=True)], dim=-1)
        mean, square = (logits.softmax(dim=-1) @ moments).split([3, 1], dim=-1)  # (batch, query cells, 3 and 1)
        spread = (square[..., 0] - mean.square().sum(dim=-1) + 1e-6).clamp_min(1e-6).sqrt()
        similarity = (logits.amax(dim=-1) / scale).clamp_min(-1.0)
        cues = torch.stack([spread * 4, similarity, query_coverage], dim=-1)
        trust = self.trust(torch.cat([query, cues], dim=-1)).squeeze(-1).sigmoid()
        return Matches(logits, mean, spread, similarity, trust * (query_coverage > MIN_COVERAGE))
