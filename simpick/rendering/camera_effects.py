"""What a camera does to an image: exposure, colour, blur, noise and compression, which MuJoCo's images do not have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Interval
from jaxtyping import Float, UInt8

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


def apply_camera_effects(
    rgb: UInt8[np.ndarray, "height width 3"], effects: CameraEffects, rng: np.random.Generator
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the image in another exposure and white balance, often blurred, noisy, compressed or without colour."""
    x = rgb.astype(np.float32) / 255
    x = x ** float(np.exp(rng.uniform(-effects.brightness, effects.brightness)))
    if rng.random() < effects.grey_share:
        x = np.repeat(x @ np.array(LUMINANCE, np.float32)[:, None], 3, axis=2)
    else:
        grey = x.mean(axis=2, keepdims=True)
        x = grey + rng.uniform(*_SATURATION) * (x - grey)
        x = x * (1 + rng.uniform(-effects.colour, effects.colour, 3)).astype(np.float32)
    middle = float(x.mean())
    x = middle + (1 + rng.uniform(-effects.brightness, effects.brightness)) * (x - middle)
    x = x * (1 + rng.uniform(-effects.brightness, effects.brightness))
    if rng.random() < _GRADIENT_SHARE:
        x = x * _light_gradient(x.shape[0], x.shape[1], rng)[..., None]
    if rng.random() < effects.blur_share:
        x = cv2.GaussianBlur(x, (0, 0), rng.uniform(_SMALLEST_BLUR_PX, effects.blur_px))
    if rng.random() < effects.noise_share:
        x = x + rng.normal(0, rng.uniform(0, effects.noise / 255), x.shape).astype(np.float32)
    out = np.clip(255 * x, 0, 255).astype(np.uint8)
    if rng.random() < effects.jpeg_share:
        quality = int(rng.integers(_JPEG_QUALITY[0], _JPEG_QUALITY[1] + 1))
        file = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        out = np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR), np.uint8)
    return out


def _light_gradient(height: int, width: int, rng: np.random.Generator) -> Float[np.ndarray, "height width"]:
    corners = rng.uniform(*_GRADIENT, (2, 2)).astype(np.float32)
    return cv2.resize(corners, (width, height), interpolation=cv2.INTER_LINEAR)
