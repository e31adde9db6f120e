"""What a camera does to an image: exposure, colour, blur, noise and compression, which MuJoCo's images do not have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Interval
from jaxtyping import Float32, UInt8

from simpick.config import Config, Fraction, NonNegativeFloat
from simpick.rendering.luminance import LUMINANCE

_BelowOne = Annotated[float, Interval(ge=0, lt=1)]
_GRADIENT_SHARE = 0.3
_GRADIENT = (0.6, 1.25)
_SATURATION = (0.4, 1.4)
_SMALLEST_BLUR_PX = 0.3
_JPEG_QUALITY = (40, 95)


@dataclass(frozen=True)
class CameraEffects(Config):
    """How strong these effects are at most."""

    brightness: _BelowOne = 0.3
    """Largest relative change of brightness and of contrast, and of the logarithm of gamma."""
    colour: _BelowOne = 0.12
    """Largest relative change of the red, green and blue gains."""
    blur_px: Annotated[float, Interval(ge=0.3, le=10)] = 1.5
    """Largest standard deviation of the blur."""
    blur_share: Fraction = 1 / 3
    """Share of images that are blurred."""
    noise: NonNegativeFloat = 8.0
    """Largest standard deviation of the noise in grey levels."""
    noise_share: Fraction = 0.5
    """Share of images with noise."""
    jpeg_share: Fraction = 0.3
    """Share of images that are compressed as JPEG."""
    grey_share: Fraction = 0.1
    """Share of images without colour."""


PHOTO_EFFECTS = CameraEffects(
    brightness=0.15, blur_px=2.1, blur_share=1.0, noise=12.0, noise_share=1.0, jpeg_share=1.0, grey_share=0.0
)
"""Of the pose benchmark's photo-like images: a blur of 1.2 px and noise of 6 grey levels on average, always JPEG."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """The effects on one image, as they were drawn: all but the compression."""

    gamma: float
    """Exponent of all intensities."""
    saturation: float | None
    """Factor on the differences between the channels; None for an image without colour."""
    gains: Float32[np.ndarray, "3"] | None
    """Factors on red, green and blue; None for an image without colour."""
    contrast: float
    """Factor on the differences from the image's mean."""
    brightness: float
    """Factor on all intensities."""
    corners: Float32[np.ndarray, "2 2"] | None
    """Light in the corners of the image, between which it is interpolated; None where it is even."""
    blur_px: float | None
    """Standard deviation of the blur; None for none."""
    noise: float | None
    """Standard deviation of the noise as a share of full intensity; None for none."""


def apply_camera_effects(
    rgb: UInt8[np.ndarray, "height width 3"], effects: CameraEffects, rng: np.random.Generator
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the image in another exposure and white balance, often blurred, noisy, compressed or without colour."""
    out = expose(rgb, draw_exposure(effects, rng), rng)
    return compress_jpeg(out, draw_jpeg_quality(effects, rng))


def draw_exposure(effects: CameraEffects, rng: np.random.Generator) -> Exposure:
    """Draw an image's effects; `draw_jpeg_quality` draws its compression."""
    gamma = float(np.exp(rng.uniform(-effects.brightness, effects.brightness)))
    saturation = gains = None
    if rng.random() >= effects.grey_share:
        saturation = rng.uniform(*_SATURATION)
        gains = (1 + rng.uniform(-effects.colour, effects.colour, 3)).astype(np.float32)
    return Exposure(
        gamma,
        saturation,
        gains,
        contrast=1 + rng.uniform(-effects.brightness, effects.brightness),
        brightness=1 + rng.uniform(-effects.brightness, effects.brightness),
        corners=rng.uniform(*_GRADIENT, (2, 2)).astype(np.float32) if rng.random() < _GRADIENT_SHARE else None,
        blur_px=rng.uniform(_SMALLEST_BLUR_PX, effects.blur_px) if rng.random() < effects.blur_share else None,
        noise=rng.uniform(0, effects.noise / 255) if rng.random() < effects.noise_share else None,
    )


def expose(
    rgb: UInt8[np.ndarray, "height width 3"], exposure: Exposure, rng: np.random.Generator
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the image with these effects; `rng` draws the noise."""
    x = rgb.astype(np.float32) / 255
    x = x**exposure.gamma
    if exposure.saturation is None or exposure.gains is None:
        x = np.repeat(x @ np.array(LUMINANCE, np.float32)[:, None], 3, axis=2)
    else:
        grey = x.mean(axis=2, keepdims=True)
        x = (grey + exposure.saturation * (x - grey)) * exposure.gains
    middle = float(x.mean())
    x = middle + exposure.contrast * (x - middle)
    x = x * exposure.brightness
    if exposure.corners is not None:
        light = cv2.resize(exposure.corners, (x.shape[1], x.shape[0]), interpolation=cv2.INTER_LINEAR)
        x = x * light[..., None]
    if exposure.blur_px is not None:
        x = cv2.GaussianBlur(x, (0, 0), exposure.blur_px)
    if exposure.noise is not None:
        x = x + rng.normal(0, exposure.noise, x.shape).astype(np.float32)
    return np.clip(255 * x, 0, 255).astype(np.uint8)


def draw_jpeg_quality(effects: CameraEffects, rng: np.random.Generator) -> int | None:
    """Draw the quality of an image's compression, None for an image that is not compressed."""
    if rng.random() >= effects.jpeg_share:
        return None
    return int(rng.integers(_JPEG_QUALITY[0], _JPEG_QUALITY[1] + 1))


def compress_jpeg(rgb: UInt8[np.ndarray, "height width 3"], quality: int | None) -> UInt8[np.ndarray, "height width 3"]:
    """Return the image as JPEG of this quality shows it, or as it is if that is None."""
    if quality is None:
        return rgb
    file = cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR), np.uint8)
