"""Batches of crops, made by loader processes: what a step takes of its views follows from the seed and the step."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from simpick.training.detector.bin_files import read_view
from simpick.training.detector.config import DetectorTrainConfig
from simpick.training.detector.crops import Crop, cut_crop, instance_areas
from simpick.training.detector.step_draws import View, draw_plans, draw_views, view_rng


@dataclass(frozen=True, eq=False)
class CropBatch:
    """Crops with what is true of their cells."""

    rgb: UInt8[Tensor, "batch 3 size size"]
    ids: UInt8[Tensor, "batch cells cells"]
    """Instance in each cell, from 1; 0 is background."""

    def pin_memory(self) -> CropBatch:
        """Return the batch in memory that a GPU reads while the CPU continues; called by torch's `DataLoader`."""
        return CropBatch(self.rgb.pin_memory(), self.ids.pin_memory())

    def to(self, device: torch.device) -> CropBatch:
        """Return the batch on a device."""
        return CropBatch(*(x.to(device, non_blocking=True) for x in (self.rgb, self.ids)))


def crop_batches(
    config: DetectorTrainConfig, bins: Callable[[], Sequence[Path]], first_step: int, loaders: int, *, pinned: bool
) -> Iterator[CropBatch]:
    """Yield the batches of the steps from `first_step`, made by `loaders` processes, or by this one if that is 0.

    `bins` returns the files that there are when a step's batch is ordered: as long as they are the same, so is a step's
    batch.
    """
    processes = (
        {"multiprocessing_context": "spawn", "worker_init_fn": _start_loader, "persistent_workers": True}
        if loaders
        else {}
    )
    return iter(
        DataLoader(
            _StepCrops(config),
            sampler=_steps(config, bins, first_step),
            batch_size=None,
            num_workers=loaders,
            pin_memory=pinned,
            **processes,
        )
    )


def _steps(
    config: DetectorTrainConfig, bins: Callable[[], Sequence[Path]], first_step: int
) -> Iterator[tuple[int, list[View]]]:
    """Yield each step with its views; runs in the training process, which knows what bins there are."""
    for step in count(first_step):
        yield step, draw_views(config, step, bins())


class _StepCrops(Dataset[CropBatch]):
    """The batch of a step and its views."""

    def __init__(self, config: DetectorTrainConfig) -> None:
        self._config = config

    def __getitem__(self, item: tuple[int, list[View]]) -> CropBatch:
        step, views = item
        config, crops = self._config, list[Crop]()
        for place, (file, view) in enumerate(views):
            rng = view_rng(config, step, place)
            # Reading an image costs as much as a crop of it.
            image = read_view(file, view)
            plans = draw_plans(config, place, instance_areas(image.ids), rng)
            crops += [cut_crop(image, plan, config.crops.size_px, rng) for plan in plans]
        return collate(crops)


def _start_loader(index: int) -> None:
    # The training process handles Ctrl-C, and finishes its step with the batches that are on their way.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)


def collate(crops: Sequence[Crop]) -> CropBatch:
    """Return crops of one size as a batch."""
    rgb = np.stack([crop.rgb.transpose(2, 0, 1) for crop in crops])
    return CropBatch(torch.from_numpy(rgb), torch.from_numpy(np.stack([crop.ids for crop in crops])))
