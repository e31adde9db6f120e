"""`Calibration`: a camera as calibration tools describe it, and what turns its images into `CameraFrame`s.

Calibrations follow OpenCV: pixel centres at integers, so that the centre of the top left pixel is (0, 0). simpick puts
it at (0.5, 0.5). The half pixel is added here and in `simpick.bop.conventions` only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from simpick.bop.conventions import PIXEL_CENTRE_PX, principal_point_contradicts
from simpick.config import Config, PositiveFloat, PositiveInt
from simpick.errors import CameraFileError, ConfigError
from simpick.geometry import Pinhole
from simpick.records import CameraFrame

PixelCentres = Literal["integer", "half"]
"""Where the centre of the first pixel is: at (0, 0) as in OpenCV, ROS, RealSense and BOP, or at (0.5, 0.5)."""
LensModel = Literal["brown_conrady", "fisheye"]

_BROWN_CONRADY_COUNTS, _FISHEYE_COUNT = (0, 4, 5, 8, 12, 14), 4
_SAME_ASPECT = 0.005


@dataclass(frozen=True)
class Calibration(Config):
    """Intrinsics and distortion of a camera, with pixel centres at integers."""

    fx: PositiveFloat
    """Focal length along x in pixels."""
    fy: PositiveFloat
    """Focal length along y in pixels."""
    cx: float
    """Principal point from the first column's centre in pixels."""
    cy: float
    """Principal point from the first row's centre in pixels."""
    width: PositiveInt | None = None
    """Image width in pixels; None where it is not stated."""
    height: PositiveInt | None = None
    """Image height in pixels; None where it is not stated."""
    lens: LensModel = "brown_conrady"
    """Meaning of `distortion`: OpenCV's standard model or its fisheye model (Kannala and Brandt, 4 coefficients)."""
    distortion: tuple[float, ...] = ()
    """OpenCV's coefficients: k1, k2, p1, p2, k3, ...; empty without distortion."""
    source: str = "the camera"
    """Where it comes from, for texts: a file and its format."""

    @staticmethod
    def from_K(
        K: Float[np.ndarray, "3 3"],
        *,
        distortion: tuple[float, ...] = (),
        pixel_centres: PixelCentres = "integer",
        size: tuple[int, int] | None = None,
        source: str = "K",
    ) -> Calibration:
        """Return the calibration of a camera matrix; `size` is width and height where they are known.

        Raises:
            CameraFileError: K is not that of a camera without skew.
        """
        if not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0 and np.allclose(K[2], [0, 0, 1])):
            raise CameraFileError(
                f"{source}: the camera matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive fx and fy, "
                f"got {np.asarray(K).tolist()}"
            )
        if abs(K[0, 1]) > 0.1 or K[1, 0] != 0:
            raise CameraFileError(f"{source}: the camera matrix has a skew of {K[0, 1]:g} px; calibrate without skew")
        shift = 0.0 if pixel_centres == "integer" else PIXEL_CENTRE_PX
        width, height = size or (None, None)
        fx, fy, cx, cy = float(K[0, 0]), float(K[1, 1]), float(K[0, 2]) - shift, float(K[1, 2]) - shift
        return Calibration(fx, fy, cx, cy, width, height, distortion=tuple(map(float, distortion)), source=source)

    def _check_rules(self) -> None:
        if (self.width is None) != (self.height is None):
            raise ConfigError("width and height must be given together")
        counts = _BROWN_CONRADY_COUNTS if self.lens == "brown_conrady" else (0, _FISHEYE_COUNT)
        if len(self.distortion) not in counts:
            raise CameraFileError(
                f"{self.source}: distortion of the {self.lens} model must have {' or '.join(map(str, counts))} "
                f"coefficients, got {len(self.distortion)}"
            )

    @property
    def is_distorted(self) -> bool:
        """Return whether any coefficient differs from 0."""
        return any(self.distortion)

    @property
    def size(self) -> tuple[int, int] | None:
        """Return the stated width and height; None where they are not stated."""
        return None if self.width is None or self.height is None else (self.width, self.height)

    @property
    def K(self) -> Float[np.ndarray, "3 3"]:
        """Return the camera matrix in OpenCV's convention."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def undistorted(self) -> Calibration:
        """Return the same camera for images that are undistorted already."""
        return replace(self, distortion=())

    def of_size(self, width: int, height: int) -> Undistortion:
        """Return what turns images of this size into frames.

        Raises:
            CameraFileError: the calibration belongs to images of another size.
        """
        if self.size is None:
            if principal_point_contradicts((self.cx + 0.5) / width, (self.cy + 0.5) / height):
                raise CameraFileError(
                    f"{self.source}: the principal point ({self.cx:g}, {self.cy:g}) px does not suit an image of "
                    f"{width} x {height} px. If the image was resized, scale fx, fy, cx and cy with it; if it was "
                    "cropped, subtract the crop's corner from cx and cy; if it is right, state width and height in a "
                    "camera file"
                )
        elif self.size != (width, height):
            raise CameraFileError(self._other_size(width, height))
        return Undistortion(replace(self, width=width, height=height))

    def describe(self) -> str:
        """Return the calibration in one line."""
        size = "size not stated" if self.size is None else f"{self.width} x {self.height} px"
        lens = f"{self.lens} distortion, {len(self.distortion)} coefficients" if self.is_distorted else "no distortion"
        return (
            f"{self.source}: {size}, f ({self.fx:g}, {self.fy:g}) px, c ({self.cx:g}, {self.cy:g}) px with pixel "
            f"centres at integers, {lens}"
        )

    def _other_size(self, width: int, height: int) -> str:
        assert self.width is not None and self.height is not None
        text = f"{self.source} belongs to images of {self.width} x {self.height} px, got {width} x {height} px. "
        x, y = width / self.width, height / self.height
        if abs(x / y - 1) < _SAME_ASPECT:
            cx, cy = (self.cx + 0.5) * x - 0.5, (self.cy + 0.5) * y - 0.5
            numbers = f"{self.fx * x:.6g} {self.fy * y:.6g} {cx:.6g} {cy:.6g}"
            return text + f"If the image was resized by {x:.4g}, these are its fx fy cx cy: {numbers}"
        if (self.height, self.width) == (width, height):
            return text + "The image is turned by 90 degrees; turn it back, or calibrate with images turned like it"
        return (
            text + "If it was cropped, subtract the crop's corner from cx and cy; else give this camera's calibration"
        )


class Undistortion:
    """Turns images of one camera into frames of a pinhole with the same camera matrix; also masks and points."""

    def __init__(self, calibration: Calibration) -> None:
        """Take a calibration with a stated size."""
        assert calibration.width is not None and calibration.height is not None
        self._calibration = calibration
        c = calibration
        self.camera = Pinhole(
            calibration.width, calibration.height, c.fx, c.fy, c.cx + PIXEL_CENTRE_PX, c.cy + PIXEL_CENTRE_PX
        )
        """The pinhole of the undistorted images, with pixel centres at integer + 0.5."""

    def frame(self, rgb: UInt8[np.ndarray, "height width 3"]) -> CameraFrame:
        """Return the undistorted image with its camera, which is the world's origin; what it does not show is black."""
        if self._calibration.is_distorted:
            rgb = cv2.remap(rgb, *self._maps, cv2.INTER_LINEAR)
        return CameraFrame(np.ascontiguousarray(rgb), self.camera, np.eye(4))

    def mask(self, mask: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
        """Return a mask of the original image in the undistorted one."""
        if not self._calibration.is_distorted:
            return mask
        return cv2.remap(255 * mask.astype(np.uint8), *self._maps, cv2.INTER_LINEAR) > 127

    def points(self, pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Return points of the original image in the undistorted one; both with pixel centres at integer + 0.5."""
        c = self._calibration
        if not c.is_distorted or len(pixels) == 0:
            return pixels
        centred = np.ascontiguousarray(pixels - PIXEL_CENTRE_PX)[:, None]
        undistort = cv2.fisheye.undistortPoints if c.lens == "fisheye" else cv2.undistortPoints
        return undistort(centred, c.K, np.array(c.distortion), R=np.eye(3), P=c.K)[:, 0] + PIXEL_CENTRE_PX

    def box(self, box_xyxy_px: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
        """Return the box around a box of the original image: around points along its edges."""
        if not self._calibration.is_distorted:
            return box_xyxy_px
        x1, y1, x2, y2 = box_xyxy_px
        t = np.linspace(0, 1, 9)
        xs, ys, ones = x1 + t * (x2 - x1), y1 + t * (y2 - y1), np.ones_like(t)
        edges = [(xs, y1 * ones), (xs, y2 * ones), (x1 * ones, ys), (x2 * ones, ys)]
        moved = self.points(np.concatenate([np.stack(edge, axis=1) for edge in edges]))
        return np.concatenate([moved.min(axis=0), moved.max(axis=0)])

    @cached_property
    def _maps(self) -> tuple[Float32[np.ndarray, "height width"], Float32[np.ndarray, "height width"]]:
        c, size = self._calibration, (self.camera.width, self.camera.height)
        init = cv2.fisheye.initUndistortRectifyMap if c.lens == "fisheye" else cv2.initUndistortRectifyMap
        x, y = init(c.K, np.array(c.distortion), np.eye(3), c.K, size, cv2.CV_32FC1)
        return x, y
