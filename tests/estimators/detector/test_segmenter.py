"""Segmentation of images of any size, and of images that show nothing."""

import numpy as np
import pytest
import torch

from simpick.errors import ConfigError
from simpick.estimators.detector.checkpoints import load_detector_checkpoint, shipped_detector_checkpoint
from simpick.estimators.detector.segmenter import InstanceSegmenter, checked_size


@pytest.fixture(scope="module")
def segmenter() -> InstanceSegmenter:
    torch.set_num_threads(1)
    return InstanceSegmenter(load_detector_checkpoint(shipped_detector_checkpoint()).network)


@pytest.mark.parametrize("colour", [0, 90, 255])
def test_an_image_of_one_colour_holds_nothing(segmenter: InstanceSegmenter, colour: int) -> None:
    assert segmenter.segment(np.full((480, 640, 3), colour, np.uint8)).masks == []


@pytest.mark.parametrize(("height", "width"), [(480, 640), (481, 643), (120, 160), (960, 1280), (640, 200)])
def test_masks_have_the_size_of_the_image(segmenter: InstanceSegmenter, height: int, width: int) -> None:
    rgb = np.full((height, width, 3), 60, np.uint8)
    rgb[height // 4 : height // 2, width // 4 : width // 2] = (200, 160, 40)
    found = segmenter.segment(rgb)
    assert all(mask.shape == (height, width) and mask.any() for mask in found.masks)
    assert ((found.scores >= 0) & (found.scores <= 1)).all()
    assert (np.diff(found.scores) <= 0).all()
    assert not len(found.masks) or np.sum(found.masks, axis=0).max() == 1, "masks do not overlap"


@pytest.mark.parametrize(
    ("rgb", "message"),
    [
        (np.zeros((480, 640), np.uint8), r"three channels \(height, width, 3\), got shape \(480, 640\)"),
        (np.zeros((480, 640, 4), np.uint8), r"three channels .* got shape \(480, 640, 4\)"),
        (np.zeros((480, 640, 3), np.float32), r"8-bit channels \(uint8\), got float32"),
        (np.zeros((8, 640, 3), np.uint8), "at least 32 px wide and high, got 640 x 8"),
    ],
)
def test_other_images_are_refused(rgb: np.ndarray, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        checked_size(rgb)
