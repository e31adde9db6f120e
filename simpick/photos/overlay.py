"""Overlays: estimated poses drawn into their image, as contours and axes, to be looked at."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from simpick.assets.part import Part
from simpick.geometry import Pinhole
from simpick.photos.cad_poses import CadPoseEstimate
from simpick.records import CameraFrame

_SHIFT = 4
"""OpenCV draws at 1 / 16 px with this many fractional bits."""
_AXES = ((255, 60, 60), (60, 220, 60), (70, 110, 255))
"""Red x, green y, blue z."""
_COLOURS = ((0, 255, 170), (255, 190, 0), (0, 200, 255), (255, 110, 200), (190, 255, 0), (170, 140, 255))
_RIVAL_COLOUR = (255, 255, 255)
_NEAR_DIAMETERS = 1.0
_STEP_SHARE = 0.02
"""A jump of depth by this share of the part's diameter is drawn as an inner contour."""


class Overlay:
    """An image into which poses are drawn: first all contours, then all axes."""

    def __init__(self, frame: CameraFrame) -> None:
        self.image: UInt8[np.ndarray, "height width 3"] = np.ascontiguousarray(frame.rgb).copy()
        self._camera = frame.camera
        self._thick = max(1, round(max(self.image.shape[:2]) / 700))

    def draw_contours(self, index: int, part: Part, depth_m: Float32[np.ndarray, "height width"]) -> None:
        """Draw the contours of a part with this depth in the colour of estimate `index`, inner ones thinner."""
        colour = _COLOURS[index % len(_COLOURS)]
        self.image[inner_contours(depth_m, _STEP_SHARE * part.diameter_m)] = colour
        self._draw_outline(depth_m, colour, self._thick)

    def draw_rival(self, depth_m: Float32[np.ndarray, "height width"]) -> None:
        """Draw the outline of a rival pose, thin and white."""
        self._draw_outline(depth_m, _RIVAL_COLOUR, 1)

    def draw_axes(self, index: int, part: Part, estimate: CadPoseEstimate) -> None:
        """Draw the CAD file's axes with half the part's diameter as length, and the score.

        They stand in the file's origin, or in the part's centre where the origin is farther from it than one diameter.
        """
        origin = _axes_origin(estimate, part.diameter_m)
        R_camera_cad = estimate.T_camera_cad[:3, :3]
        _draw_axes(self.image, self._camera, R_camera_cad, origin, part.diameter_m / 2, self._thick)
        _draw_label(self.image, self._camera, estimate, _COLOURS[index % len(_COLOURS)], self._thick)

    def _draw_outline(
        self, depth_m: Float32[np.ndarray, "height width"], colour: tuple[int, int, int], thick: int
    ) -> None:
        outlines, _ = cv2.findContours((depth_m > 0).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(self.image, outlines, -1, colour, thick, cv2.LINE_AA)


def inner_contours(depth_m: Float32[np.ndarray, "height width"], step_m: float) -> Bool[np.ndarray, "height width"]:
    """Return pixels inside the silhouette where depth jumps by more than `step_m` to a neighbour that is farther."""
    inside, contours = depth_m > 0, np.zeros(depth_m.shape, bool)
    for axis in (0, 1):
        for direction in (-1, 1):
            other = np.roll(depth_m, direction, axis)
            contours |= inside & (other > 0) & (other - depth_m > step_m)
    contours[[0, -1]] = contours[:, [0, -1]] = False
    return contours


def _axes_origin(estimate: CadPoseEstimate, diameter_m: float) -> Float[np.ndarray, "3"]:
    cad, centre = estimate.T_camera_cad[:3, 3], estimate.T_camera_part[:3, 3]
    return cad if np.linalg.norm(cad - centre) <= _NEAR_DIAMETERS * diameter_m and cad[2] > 0 else centre


def _draw_axes(
    image: UInt8[np.ndarray, "height width 3"],
    camera: Pinhole,
    R_camera_cad: Float[np.ndarray, "3 3"],
    origin: Float[np.ndarray, "3"],
    length_m: float,
    thick: int,
) -> None:
    ends = origin + length_m * R_camera_cad.T
    if origin[2] <= 0 or (ends[:, 2] <= 0).any():
        return
    # The farthest first, so that the nearest is on top.
    for axis in np.argsort(-ends[:, 2]).tolist():
        start, end = (_fixed(camera.project(point)) for point in (origin, ends[axis]))
        cv2.arrowedLine(image, start, end, _AXES[axis], thick + 1, cv2.LINE_AA, _SHIFT, 0.15)


def _draw_label(
    image: UInt8[np.ndarray, "height width 3"],
    camera: Pinhole,
    estimate: CadPoseEstimate,
    colour: tuple[int, int, int],
    thick: int,
) -> None:
    x, y = camera.project(estimate.T_camera_part[:3, 3])
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        return
    text, scale = f"{estimate.part} {estimate.score:.2f}", 0.45 * thick
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, thick)
    place = int(np.clip(x, 0, max(camera.width - width, 0))), int(np.clip(y + 14 * thick, 12, camera.height - 4))
    # Its outline is the text itself, moved: thicker letters are wider in some versions of OpenCV.
    around = [(right, down) for right in (-thick, 0, thick) for down in (-thick, 0, thick)]
    for (right, down), shade in [*((move, (0, 0, 0)) for move in around), ((0, 0), colour)]:
        at = place[0] + right, place[1] + down
        cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, shade, thick, cv2.LINE_AA)


def _fixed(pixel: Float[np.ndarray, "2"]) -> tuple[int, int]:
    """Return OpenCV's fixed-point coordinates, whose pixel centres are at integers, of a pixel."""
    x, y = np.clip(np.rint((pixel - 0.5) * (1 << _SHIFT)), -(2**20), 2**20).astype(int).tolist()
    return x, y
