"""Tiny bins, made once, and a training configuration of a few steps."""

from pathlib import Path

import numpy as np
import pytest

from simpick.training.detector.bin_data import BinDataConfig, BinImage
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


@pytest.fixture
def image() -> BinImage:
    """Two instances, each with its own colour, so that colours say where it is."""
    ids = np.zeros((160, 200), np.uint8)
    ids[30:80, 40:90] = 1
    ids[60:130, 100:160] = 2
    colours = np.array([[20, 20, 20], [220, 40, 40], [40, 40, 220]], np.uint8)
    return BinImage(colours[ids], ids, np.array([1.0, 0.9], np.float32))
