"""The pinhole camera, and the one function that flips between MuJoCo's and OpenCV's camera axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError

_FLIP_YZ = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Pinhole:
    """Intrinsics of a camera without distortion; pixel centres at integer + 0.5."""

    width: int
    """Image width in pixels."""
    height: int
    """Image height in pixels."""
    fx: float
    """Focal length along x in pixels."""
    fy: float
    """Focal length along y in pixels."""
    cx: float
    """Principal point from the left edge in pixels."""
    cy: float
    """Principal point from the top edge in pixels."""

    def __post_init__(self) -> None:
        if self.width <= 0 or self.height <= 0:
            raise ConfigError(f"image size must be positive, got {self.width} x {self.height} px")
        if not (self.fx > 0 and self.fy > 0):
            raise ConfigError(f"focal lengths must be positive, got fx={self.fx}, fy={self.fy}")

    @staticmethod
    def from_fovy(width: int, height: int, fovy_deg: float) -> Pinhole:
        """Return the camera with square pixels, a centred principal point and this vertical field of view."""
        if not 0 < fovy_deg < 180:
            raise ConfigError(f"fovy must be between 0 and 180 degrees, got {fovy_deg}")
        f = 0.5 * height / np.tan(np.radians(fovy_deg) / 2)
        return Pinhole(width, height, float(f), float(f), width / 2, height / 2)

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


def opencv_from_mujoco_camera(
    T_world_mjcamera: Float[np.ndarray, "*batch 4 4"],
) -> Float[np.ndarray, "*batch 4 4"]:
    """Return T_world_camera (OpenCV axes) of a MuJoCo or OpenGL camera frame. Its own inverse."""
    return T_world_mjcamera @ _FLIP_YZ
