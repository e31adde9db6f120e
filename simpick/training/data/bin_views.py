"""Cameras and lights of the views of a shard's bin."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from simpick.geometry import Pinhole, look_at, so3_exp, transform
from simpick.rendering import Viewpoint
from simpick.scene.randomization import RANDOMIZATIONS, Look, draw_look
from simpick.scene.workspace import BIN_CENTRE_M
from simpick.training.data.data_config import DataConfig

# Around each target's origin, in diameters: half for the target, the rest for the surroundings in its crop.
_MARGIN = 1.0
_SMALLEST_PX = 64


def draw_viewpoint(
    config: DataConfig,
    targets_m: Float[np.ndarray, "n 3"],
    diameter_m: float,
    rng: np.random.Generator,
) -> Viewpoint:
    """Return a camera that looks at a point between the bin's centre and a target, with a random focal length.

    Its image is cropped to the targets to save rendering, which moves the principal point.
    """
    # Uniform over the cap of directions.
    tilt = np.radians(config.tilt_deg) * np.sqrt(rng.random())
    azimuth, roll = rng.uniform(0, 2 * np.pi, size=2)
    distance = rng.uniform(*config.distance_m)
    diameter_px = float(np.exp(rng.uniform(*np.log(config.diameter_px))))
    target = targets_m[rng.integers(len(targets_m))]
    aim = np.array(BIN_CENTRE_M) + rng.random() * (target - np.array(BIN_CENTRE_M))
    direction = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    T_world_camera = look_at(aim + distance * direction, aim) @ transform(so3_exp(roll * np.array([0.0, 0.0, 1.0])))
    focal = diameter_px * distance / diameter_m
    return Viewpoint(_window(config, focal, _MARGIN * diameter_px, targets_m, T_world_camera), T_world_camera)


def _window(
    config: DataConfig,
    focal: float,
    margin_px: float,
    targets_m: Float[np.ndarray, "n 3"],
    T_world_camera: Float[np.ndarray, "4 4"],
) -> Pinhole:
    """Return the camera whose image contains all targets, as far as they lie in the largest image allowed."""
    points = (targets_m - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    pixels = focal * points[:, :2] / points[:, 2:]
    half = np.array([config.image_width_px, config.image_height_px]) / 2
    low = np.floor(np.clip(pixels.min(axis=0) - margin_px, -half, half - _SMALLEST_PX))
    high = np.ceil(np.clip(pixels.max(axis=0) + margin_px, low + _SMALLEST_PX, half))
    width, height = (high - low).astype(int)
    return Pinhole(int(width), int(height), focal, focal, float(-low[0]), float(-low[1]))


def draw_view_look(config: DataConfig, count: int, rng: np.random.Generator) -> Look:
    """Return the look of one view of a bin with `count` parts."""
    preset = RANDOMIZATIONS[config.randomizations[rng.integers(len(config.randomizations))]]
    return draw_look(preset, count, rng)
