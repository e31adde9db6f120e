"""Effects on a batch are those on each image alone."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from simpick.rendering.camera_effects import CameraEffects, Exposure, compress_jpeg, draw_exposure, expose
from simpick.training.detector.tensor_effects import apply_tensor_effects
from simpick.training.detector.tensor_jpeg import compress_jpegs

NO_EFFECT = Exposure(1.0, 1.0, np.ones(3, np.float32), 1.0, 1.0, None, None, None)
CORNERS = np.array([[0.6, 1.2], [1.0, 0.8]], np.float32)
EFFECTS = {
    "none": {},
    "gamma": {"gamma": 1.3},
    "saturation": {"saturation": 0.4},
    "gains": {"gains": np.array([1.1, 0.9, 1.0], np.float32)},
    "no colour": {"saturation": None, "gains": None},
    "contrast": {"contrast": 1.3},
    "brightness": {"brightness": 0.7},
    "light": {"corners": CORNERS},
    "blur": {"blur_px": 1.5},
    "weak blur": {"blur_px": 0.3},
    "strong blur": {"blur_px": 6.0},
}


def scene(seed: int) -> np.ndarray:
    """Return an image with edges, in moderate colours."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(30, 220, (8, 8, 3)).astype(np.uint8)
    image = cv2.resize(coarse, (64, 64), interpolation=cv2.INTER_NEAREST)
    return cv2.addWeighted(image, 0.8, cv2.resize(coarse[::-1], (64, 64)), 0.2, 0)


def to_batch(images: list[np.ndarray]) -> torch.Tensor:
    return torch.from_numpy(np.stack(images).transpose(0, 3, 1, 2)).float()


def applied(images: list[np.ndarray], exposures: list[Exposure], seed: int = 0) -> np.ndarray:
    generator = torch.Generator().manual_seed(seed)
    out = apply_tensor_effects(to_batch(images), exposures, [None] * len(images), generator)
    return out.permute(0, 2, 3, 1).numpy()


@pytest.mark.parametrize("name", EFFECTS)
def test_each_effect_is_that_on_one_image(name: str) -> None:
    exposures = [replace(NO_EFFECT, **EFFECTS[name]), NO_EFFECT]
    images = [scene(0), scene(1)]
    together = applied(images, exposures).astype(int)
    for image, exposure, out in zip(images, exposures, together, strict=True):
        alone = expose(image, exposure, np.random.default_rng(0)).astype(int)
        # Intensities are cut off to whole grey levels: rounding may decide.
        assert np.abs(out - alone).max() <= 1
    if name != "none":
        assert np.abs(together[0] - images[0]).mean() > 0.2


def test_drawn_effects_are_applied_to_each_image() -> None:
    rng = np.random.default_rng(4)
    exposures = [draw_exposure(CameraEffects(noise_share=0.0), rng) for _ in range(12)]
    images = [scene(seed) for seed in range(12)]
    alone = np.stack([expose(image, e, rng) for image, e in zip(images, exposures, strict=True)])
    assert np.abs(applied(images, exposures).astype(int) - alone).max() <= 1


def test_noise_has_its_standard_deviation_and_follows_from_the_generator() -> None:
    grey, exposures = [np.full((64, 64, 3), 120, np.uint8)] * 2, [replace(NO_EFFECT, noise=8 / 255), NO_EFFECT]
    out = applied(grey, exposures)
    assert out[0].std() == pytest.approx(8, rel=0.1)
    assert np.abs(out[1].astype(int) - 120).max() <= 1
    np.testing.assert_array_equal(out, applied(grey, exposures))
    assert (out != applied(grey, exposures, seed=1)).any()


@pytest.mark.parametrize("quality", [40, 95])
def test_compression_loses_as_much_as_opencvs(quality: int) -> None:
    images = [scene(seed) for seed in range(4)]
    ours = compress_jpegs(to_batch(images), torch.full((4,), quality)).permute(0, 2, 3, 1).numpy()
    # OpenCV takes blue first.
    theirs = np.stack([compress_jpeg(np.ascontiguousarray(im[..., ::-1]), quality)[..., ::-1] for im in images])
    error, its_error = np.abs(ours - np.stack(images)).mean(), np.abs(theirs - np.stack(images).astype(float)).mean()
    assert error == pytest.approx(its_error, rel=0.15)
    assert np.abs(ours - theirs).mean() < 0.6 * its_error


def test_only_images_with_a_quality_are_compressed() -> None:
    images = [scene(0), scene(0)]
    out = apply_tensor_effects(to_batch(images), [NO_EFFECT] * 2, [None, 10], torch.Generator())
    changes = (out.float() - to_batch(images)).abs().mean((1, 2, 3))
    assert changes[0] < 1 < changes[1]
