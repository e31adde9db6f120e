"""Crops that are cut together show what crops that are cut one by one show."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from simpick.rendering.camera_effects import Exposure
from simpick.training.detector.bin_data import BinImage
from simpick.training.detector.config import CropConfig
from simpick.training.detector.crop_plans import CropPlan, draw_plan
from simpick.training.detector.crops import cut_crop, instance_areas
from simpick.training.detector.tensor_crops import cut_crops

SIZE_PX = 128
NO_EFFECT = Exposure(1.0, 1.0, np.ones(3, np.float32), 1.0, 1.0, None, None, None)


def textured(image: BinImage) -> BinImage:
    """Return the image with smooth colours that no two places share."""
    noise = np.random.default_rng(0).integers(0, 256, (*image.ids.shape, 3)).astype(np.uint8)
    return BinImage(cv2.GaussianBlur(noise, (0, 0), 2.0), image.ids, None)


def cut_both_ways(image: BinImage, plans: list[CropPlan]) -> tuple[np.ndarray, ...]:
    """Return colours and ids, cut together and one by one."""
    plans = [replace(plan, exposure=NO_EFFECT, jpeg_quality=None) for plan in plans]
    count = len(plans)
    rgb = torch.from_numpy(image.rgb.transpose(2, 0, 1).copy()).expand(count, -1, -1, -1)
    blank = torch.from_numpy(np.rint(cv2.mean(image.rgb)[:3]).astype(np.uint8)).expand(count, 3)
    colours, ids = cut_crops(rgb, torch.from_numpy(image.ids).expand(count, -1, -1), blank, plans, SIZE_PX)
    alone = [cut_crop(image, plan, SIZE_PX, np.random.default_rng(0)) for plan in plans]
    return (
        colours.permute(0, 2, 3, 1).numpy(),
        ids.numpy(),
        np.stack([crop.rgb for crop in alone]).astype(np.float32),
        np.stack([crop.ids for crop in alone]),
    )


@pytest.mark.parametrize("instance_share", [0.0, 1.0])
def test_crops_agree_with_those_of_opencv(image: BinImage, instance_share: float) -> None:
    config, rng = CropConfig(size_px=SIZE_PX, instance_share=instance_share), np.random.default_rng(3)
    plans = [draw_plan(instance_areas(image.ids), config, rng) for _ in range(16)]
    rgb, ids, rgb_alone, ids_alone = cut_both_ways(textured(image), plans)
    assert np.abs(rgb - rgb_alone).mean(axis=(1, 2, 3)).max() < 2
    assert (ids != ids_alone).mean(axis=(1, 2)).max() < 0.002


def test_an_image_without_parts_is_cut_at_the_same_place(image: BinImage) -> None:
    empty = textured(BinImage(image.rgb, np.zeros_like(image.ids), None))
    config, rng = CropConfig(size_px=SIZE_PX), np.random.default_rng(5)
    rgb, ids, rgb_alone, _ = cut_both_ways(empty, [draw_plan(instance_areas(empty.ids), config, rng)])
    assert np.abs(rgb - rgb_alone).mean() < 2 and not ids.any()


def test_the_planned_pixel_lies_at_its_target(image: BinImage) -> None:
    """Pixel 7 of instance 2 is in its first row; an unturned crop of twice the size shows it where it is wanted."""
    plan = draw_plan(instance_areas(image.ids), CropConfig(size_px=SIZE_PX), np.random.default_rng(0))
    plan = replace(plan, instance=2, pixel=7, linear=2 * np.eye(2), target_px=np.array([40.0, 50.0]))
    marked = BinImage(np.zeros_like(image.rgb), image.ids, None)
    marked.rgb[60, 107] = 200
    rgb = cut_both_ways(marked, [plan])[0]
    assert np.unravel_index(rgb[0, ..., 0].argmax(), (SIZE_PX, SIZE_PX)) == (50, 40)
    assert rgb[0, 50, 40, 0] == 200
