"""Camera effects change an image as a camera would, and by the generator alone."""

import numpy as np
import pytest

from simpick.rendering.camera_effects import CameraEffects, apply_camera_effects

NONE = CameraEffects(brightness=0.0, colour=0.0, noise=0.0, jpeg_share=0.0, grey_share=0.0)


@pytest.fixture
def rgb() -> np.ndarray:
    return np.random.default_rng(0).integers(60, 190, (40, 60, 3)).astype(np.uint8)


def test_the_same_generator_gives_the_same_image(rgb: np.ndarray) -> None:
    first, second = (apply_camera_effects(rgb, CameraEffects(), np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert first.shape == rgb.shape and first.dtype == np.uint8
    assert (first != rgb).any()


def test_without_colour_all_channels_are_equal(rgb: np.ndarray) -> None:
    grey = apply_camera_effects(rgb, CameraEffects(grey_share=1.0, noise=0.0, jpeg_share=0.0), np.random.default_rng(1))
    assert int(np.ptp(grey.astype(int), axis=2).max()) <= 1


def test_noise_grows_with_its_setting(rgb: np.ndarray) -> None:
    flat = np.full_like(rgb, 120)

    def roughness(noise: float) -> float:
        effects = CameraEffects(brightness=0.0, colour=0.0, noise=noise, jpeg_share=0.0, grey_share=0.0)
        images = [apply_camera_effects(flat, effects, np.random.default_rng(seed)) for seed in range(20)]
        return max(float(np.diff(image.astype(float), axis=1).std()) for image in images)

    assert roughness(0.0) < 2
    assert roughness(30.0) > 10


@pytest.mark.parametrize("seed", range(4))
def test_without_effects_only_saturation_light_and_blur_differ(rgb: np.ndarray, seed: int) -> None:
    grey = np.repeat(rgb[..., :1], 3, axis=2)
    out = apply_camera_effects(np.full_like(grey, 100), NONE, np.random.default_rng(seed))
    # Flat grey has nothing to saturate or blur: only the gradient of the light is left.
    assert out.min() >= 0.55 * 100 and out.max() <= 1.26 * 100
    assert int(np.ptp(out.astype(int), axis=2).max()) <= 1
