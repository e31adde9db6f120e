"""Batches of crops: which bin, view and crop each step takes follows from the seed and the step alone."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from simpick.training.detector.bin_files import read_view
from simpick.training.detector.config import DetectorTrainConfig
from simpick.training.detector.crops import Crop, draw_crop


@dataclass(frozen=True, eq=False)
class CropBatch:
    """Crops with what is true of their cells."""

    rgb: UInt8[Tensor, "batch 3 size size"]
    ids: Int[Tensor, "batch cells cells"]
    centre: Float[Tensor, "batch cells cells"]
    """1 in the middle of an instance's visible pixels, falling off as a Gaussian."""
    to_centre: Float[Tensor, "batch 2 cells cells"]
    """(rows, columns) to that middle in cells; 0 in the background."""

    def to(self, device: torch.device) -> CropBatch:
        """Return the batch on a device."""
        return CropBatch(*(x.to(device, non_blocking=True) for x in (self.rgb, self.ids, self.centre, self.to_centre)))


_SIGMA_CELLS = 2.5
_REACH = 8


class CropBatches:
    """Makes batches, `workers` of them at a time ahead of use; 0 makes each when it is asked for."""

    def __init__(self, config: DetectorTrainConfig, files: Sequence[Path], workers: int = 0) -> None:
        self._config, self._files, self._workers = config, files, workers
        self._pool = ThreadPoolExecutor(workers) if workers else None
        self._pending: dict[int, Future[CropBatch]] = {}

    def get(self, step: int) -> CropBatch:
        """Return the batch of a step."""
        if self._pool is None:
            return self._make(step)
        for ahead in range(step, step + 2 * self._workers):
            if ahead not in self._pending:
                self._pending[ahead] = self._pool.submit(self._make, ahead)
        return self._pending.pop(step).result()

    def _make(self, step: int) -> CropBatch:
        config = self._config
        crops = []
        while len(crops) < config.batch:
            rng = np.random.default_rng([config.seed, 16, step, len(crops)])
            file, view = self._files[int(rng.integers(len(self._files)))], int(rng.integers(config.data.views))
            image = read_view(file, view)
            # Reading an image costs as much as a crop of it.
            crops += [draw_crop(image, config.crops, rng) for _ in range(min(2, config.batch - len(crops)))]
        return collate(crops)

    def close(self) -> None:
        """Stop the threads."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)


def collate(crops: Sequence[Crop]) -> CropBatch:
    """Return crops of one size as a batch."""
    ids = np.stack([crop.ids for crop in crops]).astype(np.int64)
    targets = [_centre_targets(crop) for crop in crops]
    return CropBatch(
        torch.from_numpy(np.stack([crop.rgb.transpose(2, 0, 1) for crop in crops])),
        torch.from_numpy(ids),
        torch.from_numpy(np.stack([heat for heat, _ in targets])),
        torch.from_numpy(np.stack([offsets for _, offsets in targets])),
    )


def _centre_targets(crop: Crop) -> tuple[Float[np.ndarray, "cells cells"], Float[np.ndarray, "2 cells cells"]]:
    cells = crop.ids.shape[0]
    y, x = np.mgrid[:cells, :cells].astype(np.float32)
    centres = np.concatenate([np.zeros((1, 2), np.float32), crop.centres])
    own = centres[crop.ids]
    is_part = crop.ids > 0
    offsets = np.stack([own[..., 0] - y, own[..., 1] - x]) * is_part
    heat = np.zeros((cells, cells), np.float32)
    for k in np.unique(crop.ids[is_part]):
        row, column = crop.centres[k - 1]
        top, left = max(int(row) - _REACH, 0), max(int(column) - _REACH, 0)
        window = (slice(top, max(int(row) + _REACH + 1, 0)), slice(left, max(int(column) + _REACH + 1, 0)))
        bump = np.exp(-((y[window] - row) ** 2 + (x[window] - column) ** 2) / (2 * _SIGMA_CELLS**2))
        heat[window] = np.maximum(heat[window], bump)
    return heat, offsets.astype(np.float32)
