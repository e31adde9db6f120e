"""Batches follow from seed, step and bins, whoever makes them."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from simpick.training.detector.batches import crop_batches
from simpick.training.detector.bin_files import bin_file
from tests.training.detector.conftest import TINY_DATA, TINY_TRAINING

pytestmark = pytest.mark.render
CONFIG = replace(TINY_TRAINING, batch=5, crops_per_view=2)


@pytest.fixture
def files(tiny_bins: Path) -> list[Path]:
    return [bin_file(tiny_bins, TINY_DATA, "train", 0)]


def test_a_batch_has_all_its_crops(files: list[Path]) -> None:
    batch = next(crop_batches(CONFIG, lambda: files, 0, 0, pinned=False))
    assert batch.rgb.shape == (5, 3, 64, 64) and batch.ids.shape == (5, 32, 32)
    assert not torch.equal(batch.rgb[0], batch.rgb[1])


def test_loader_processes_make_the_same_batches_from_any_step(files: list[Path]) -> None:
    here = crop_batches(CONFIG, lambda: files, 0, 0, pinned=False)
    first, second = next(here), next(here)
    there = next(crop_batches(CONFIG, lambda: files, 1, 1, pinned=False))
    assert torch.equal(there.rgb, second.rgb) and torch.equal(there.ids, second.ids)
    assert not torch.equal(first.rgb, second.rgb)


def test_new_bins_are_used_as_soon_as_they_are_ready(files: list[Path], tmp_path: Path) -> None:
    ready = list(files)
    batches = crop_batches(CONFIG, lambda: ready, 0, 0, pinned=False)
    next(batches)
    ready[:] = [tmp_path / "new.npz"]
    with pytest.raises(Exception, match=r"new\.npz is missing or damaged"):
        next(batches)
