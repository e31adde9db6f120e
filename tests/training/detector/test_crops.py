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
from simpick.training.detector.crop_plans import ANY_PART, draw_plan
from simpick.training.detector.crops import Crop, cut_crop, instance_areas
from simpick.training.detector.losses import loss_terms, weighted_sum
from tests.estimators.detector.ideal_maps import ideal_maps

PLAIN = CropConfig(
    size_px=128, effects=CameraEffects(brightness=0.0, colour=0.0, noise=0.0, jpeg_share=0.0, grey_share=0.0)
)


def draw_crop(image: BinImage, config: CropConfig, rng: np.random.Generator) -> Crop:
    return cut_crop(image, draw_plan(instance_areas(image.ids), config, rng), config.size_px, rng)


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


def test_all_instances_have_equal_shares_of_the_crops_around_instances(image: BinImage) -> None:
    areas, config, rng = instance_areas(image.ids), CropConfig(size_px=64, instance_share=0.5), np.random.default_rng(0)
    chosen = [draw_plan(areas, config, rng).instance for _ in range(400)]
    assert set(chosen) == {ANY_PART, 1, 2}
    assert chosen.count(ANY_PART) == pytest.approx(200, abs=50)
    assert chosen.count(1) == pytest.approx(100, abs=40)


@pytest.mark.parametrize("instance_share", [0.0, 1.0])
def test_the_planned_pixel_shows_a_part(image: BinImage, instance_share: float) -> None:
    config = CropConfig(size_px=64, instance_share=instance_share, effects=PLAIN.effects)
    rng = np.random.default_rng(0)
    for _ in range(20):
        plan = draw_plan(instance_areas(image.ids), config, rng)
        x, y = (plan.target_px // 2).astype(int)
        crop = cut_crop(image, plan, 64, rng)
        shown = set(crop.ids[y - 1 : y + 2, x - 1 : x + 2].ravel().tolist())
        assert shown & ({1, 2} if plan.instance == ANY_PART else {plan.instance})


def test_a_view_without_parts_has_crops_too(image: BinImage) -> None:
    empty = BinImage(image.rgb, np.zeros_like(image.ids), None)
    assert not draw_crop(empty, PLAIN, np.random.default_rng(0)).ids.any()
