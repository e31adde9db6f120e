"""Which cells of a crop show the part: estimated from image and mask, because masks of detectors are wrong.

Not in the paper, whose crops are cut out by the detector's masks.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

_HIDDEN = 32
_MASK_LOGIT = 4.0
"""Before training, a cell is visible with this log-odds where the mask covers it, and invisible where it does not."""


class VisibilityHead(nn.Module):
    """A small network on the image features of both levels that corrects the mask's coverage."""

    def __init__(self, fine_width: int, coarse_width: int) -> None:
        super().__init__()
        self.from_fine = nn.Conv2d(fine_width, _HIDDEN, 1)
        self.from_coarse = nn.Conv2d(coarse_width, _HIDDEN, 1)
        self.join = nn.Conv2d(_HIDDEN, _HIDDEN, 3, 1, 1)
        self.out = nn.Conv2d(_HIDDEN, 1, 1)
        self.trust = nn.Parameter(torch.tensor(_MASK_LOGIT))
        nn.init.zeros_(self.out.weight)
        assert self.out.bias is not None
        nn.init.zeros_(self.out.bias)

    def forward(
        self,
        fine: Float[Tensor, "batch fine side side"],
        coarse: Float[Tensor, "batch coarse h w"],
        masks: Float[Tensor, "batch size size"],
    ) -> Float[Tensor, "batch cells"]:
        """Return the share of each cell of the fine level that shows the part, in [0, 1], row by row."""
        side = fine.shape[-1]
        coarse = F.interpolate(self.from_coarse(coarse), scale_factor=2, mode="bilinear", align_corners=False)
        x = F.relu(self.join(F.relu(self.from_fine(fine) + coarse)))
        covered = F.adaptive_avg_pool2d(masks[:, None], side)
        logits = self.out(x).float() + self.trust * (2 * covered - 1)
        return logits.sigmoid().flatten(1)
