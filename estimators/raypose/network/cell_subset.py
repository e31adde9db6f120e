"""`CellSubset`: the cells of each row that matter, so that the rest costs nothing."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor


@dataclass(frozen=True, eq=False)
class CellSubset:
    """Equally many cells of each row: those that are needed, and others where a row needs fewer."""

    index: Int[Tensor, "batch kept"]

    @staticmethod
    def of(needed: Bool[Tensor, "batch cells"]) -> CellSubset:
        """Return the needed cells in their order, then others; one cell or more."""
        kept = max(1, int(needed.sum(dim=1).max()))
        return CellSubset(needed.byte().argsort(dim=1, descending=True, stable=True)[:, :kept])

    def take(self, cells: Tensor) -> Tensor:
        """Return these cells of a tensor (batch, cells, ...)."""
        return torch.take_along_dim(cells, self._index_like(cells), dim=1)

    def put(self, kept: Float[Tensor, "batch kept channels"], cells: int) -> Float[Tensor, "batch cells channels"]:
        """Return the values of these cells among all `cells`, 0 elsewhere: the inverse of `take`."""
        everything = kept.new_zeros(len(kept), cells, kept.shape[-1])
        return everything.scatter(1, self._index_like(kept).expand_as(kept), kept)

    def _index_like(self, x: Tensor) -> Tensor:
        return self.index.view(*self.index.shape, *[1] * (x.ndim - 2))
