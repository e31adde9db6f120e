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
        return select_rows(cells, self.index)

    def put(self, kept: Float[Tensor, "batch kept channels"], cells: int) -> Float[Tensor, "batch cells channels"]:
        """Return the values of these cells among all `cells`, 0 elsewhere: the inverse of `take`."""
        everything = kept.new_zeros(len(kept) * cells, kept.shape[-1])
        everything = everything.index_copy(0, _flat(self.index, cells), kept.flatten(0, 1))
        return everything.unflatten(0, (len(kept), cells))


def select_rows(x: Tensor, index: Int[Tensor, "batch kept"]) -> Tensor:
    """Return ``x[k, index[k]]`` for each k of a tensor (batch, rows, ...); copies whole rows, unlike a gather."""
    flat = x.flatten(0, 1).index_select(0, _flat(index, x.shape[1]))
    return flat.unflatten(0, (len(index), index.shape[1]))


def _flat(index: Int[Tensor, "batch kept"], rows: int) -> Int[Tensor, "all_kept"]:
    first = rows * torch.arange(len(index), device=index.device)
    return (index + first[:, None]).flatten()
