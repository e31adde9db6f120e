"""Tiny bins, made once, and a training configuration of a few steps."""

from pathlib import Path

import pytest

from simpick.training.detector.bin_data import BinDataConfig
from simpick.training.detector.bin_files import bin_file, write_bin
from simpick.training.detector.config import CropConfig, DetectorTrainConfig

TINY_DATA = BinDataConfig(views=2, count=(3, 4), width_px=192, height_px=160)
TINY_TRAINING = DetectorTrainConfig(
    bins=2,
    curved_bins=1,
    batch=2,
    warmup_steps=1,
    validation_bins=1,
    crops=CropConfig(size_px=64),
    data=TINY_DATA,
)


@pytest.fixture(scope="session")
def tiny_bins(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all bins that `TINY_TRAINING` needs, besides the bent ones."""
    folder = tmp_path_factory.mktemp("bins")
    write_bin(folder, TINY_DATA, "train", 0)
    assert bin_file(folder, TINY_DATA, "train", 0).exists()
    return folder
