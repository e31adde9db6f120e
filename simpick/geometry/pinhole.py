"""The pinhole camera, and the only function that converts between MuJoCo's and OpenCV's camera axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.config import Config, PositiveFloat, PositiveInt
from simpick.errors import ConfigError

_FLIP_YZ = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Pinhole(Config):
    """Intrinsics of a camera without distortion; pixel centres at integer + 0.5."""

    width: PositiveInt
    """Image width in pixels."""
    height: PositiveInt
    """Image height in pixels."""
    fx: PositiveFloat
    """Focal length along x in pixels."""
    fy: PositiveFloat
    """Focal length along y in pixels."""
    cx: float
    """Principal point from the left edge in pixels."""
    cy: float
    """Principal point from the top edge in pixels."""

    @staticmethod
    def from_fovy(width: int, height: int, fovy_deg: float) -> Pinhole:
        """Return the camera with square pixels, a centred principal point and this vertical field of view."""
        if not 0 < fovy_deg < 180:
            raise ConfigError(f"fovy must be between 0 and 180 degrees, got {fovy_deg}")
        f = 0.5 * height / np.tan(np.radians(fovy_deg) / 2)
        return Pinhole(width, height, float(f), float(f), width / 2, height / 2)

    @staticmethod
    def from_K(width: int, height: int, K: Float[np.ndarray, "3 3"]) -> Pinhole:
        """Return the camera of this matrix, without skew and with pixel centres at integer + 0.5."""
        if not np.allclose([K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1], 0, atol=1e-9):
            raise ConfigError(f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {K.tolist()}")
        return Pinhole(width, height, float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))

    def resized(self, width: int, height: int) -> Pinhole:
        """Return the camera with the same field of view and another image size."""
        x, y = width / self.width, height / self.height
        return Pinhole(width, height, self.fx * x, self.fy * y, self.cx * x, self.cy * y)

    @property
    def K(self) -> Float[np.ndarray, "3 3"]:
        """Return the matrix that maps camera coordinates to homogeneous pixels."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def fovy_deg(self) -> float:
        """Return the vertical field of view in degrees."""
        return float(np.degrees(2 * np.arctan(0.5 * self.height / self.fy)))

    def project(self, points_camera: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
        """Return pixels of points in front of the camera (z > 0, metres)."""
        xy = points_camera[..., :2] / points_camera[..., 2:]
        return xy * np.array([self.fx, self.fy]) + np.array([self.cx, self.cy])

    def back_project(
        self, pixels: Float[np.ndarray, "*batch 2"], depth_m: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch 3"]:
        """Return camera coordinates of pixels at these depths along the optical axis."""
        xy = (pixels - np.array([self.cx, self.cy])) / np.array([self.fx, self.fy])
        return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1) * np.asarray(depth_m)[..., None]

    def rays(self) -> Float[np.ndarray, "height width 3"]:
        """Return the directions (x, y, 1) through all pixel centres; times depth, they are camera coordinates."""
        x = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        y = (np.arange(self.height) + 0.5 - self.cy) / self.fy
        xx, yy = np.meshgrid(x, y)
        return np.stack([xx, yy, np.ones_like(xx)], axis=-1)


def opencv_from_mujoco_camera(T_world_mjcamera: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]:
    """Return T_world_camera (OpenCV axes) of a MuJoCo or OpenGL camera frame. Its own inverse."""
    return T_world_mjcamera @ _FLIP_YZ
