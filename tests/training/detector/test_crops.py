"""Crops and their targets stay aligned with the image, however it is moved."""

import numpy as np
import pytest
import torch

from simpick.estimators.detector.affinities import OFFSETS
from simpick.estimators.detector.network import CellMaps
from simpick.rendering.camera_effects import CameraEffects
from simpick.training.detector.batches import collate
from simpick.training.detector.bin_data import BinImage
from simpick.training.detector.config import CropConfig, LossWeights
from simpick.training.detector.crops import draw_crop
from simpick.training.detector.losses import loss_terms, weighted_sum
from tests.estimators.detector.ideal_maps import ideal_maps

PLAIN = CropConfig(
    size_px=128, effects=CameraEffects(brightness=0.0, colour=0.0, noise=0.0, jpeg_share=0.0, grey_share=0.0)
)


@pytest.fixture
def image() -> BinImage:
    ids = np.zeros((160, 200), np.uint8)
    ids[30:80, 40:90] = 1
    ids[60:130, 100:160] = 2
    # Each instance has its own colour, so that colours say where it is.
    colours = np.array([[20, 20, 20], [220, 40, 40], [40, 40, 220]], np.uint8)
    return BinImage(colours[ids], ids, np.array([1.0, 0.9], np.float32))


@pytest.mark.parametrize("seed", range(6))
def test_pixels_and_cells_show_the_same_instance(image: BinImage, seed: int) -> None:
    crop = draw_crop(image, PLAIN, np.random.default_rng(seed))
    cells = crop.rgb.reshape(64, 2, 64, 2, 3).mean(axis=(1, 3))
    for number, channel in ((1, 0), (2, 2)):
        is_coloured = cells[..., channel] > cells[..., 2 - channel] + 30
        agreement = (is_coloured == (crop.ids == number)).mean()
        assert agreement > 0.95


def test_the_same_generator_gives_the_same_crop(image: BinImage) -> None:
    first, second = (draw_crop(image, CropConfig(size_px=64), np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(first.rgb, second.rgb)
    np.testing.assert_array_equal(first.ids, second.ids)


def test_perfect_maps_have_next_to_no_loss_and_reversed_ones_have_much(image: BinImage) -> None:
    batch = collate([draw_crop(image, PLAIN, np.random.default_rng(1))])
    foreground, affinities = (torch.from_numpy(x)[None] for x in ideal_maps(batch.ids[0].numpy()))

    def loss(sign: float) -> float:
        maps = CellMaps(sign * (24 * foreground - 12), sign * (24 * affinities - 12))
        return float(weighted_sum(loss_terms(maps, batch), LossWeights()))

    assert loss(1.0) < 0.01
    assert loss(-1.0) > 10
    assert len(OFFSETS) == affinities.shape[1]
