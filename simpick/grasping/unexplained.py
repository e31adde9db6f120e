"""What the image shows and no probable pose explains: an obstacle as high as it may be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from simpick.assets.part import Part
from simpick.geometry import Pinhole, invert
from simpick.geometry.transforms import transform_points
from simpick.grasping.part_surface import point_spacing_m, surface_points

TRUSTED_SCORE = 0.1
"""An estimate with a lower score is neither grasped nor in the way for certain: it is probably wrong."""
EXPLAINING_SCORE = 0.3
"""An estimate with a lower score explains nothing: something lies there, but perhaps not as estimated."""
_STRIDE_PX = 4
_STEP_M = 0.006
_MARGIN_PX = 3
_NOISE_PX = 5
"""What is narrower than this is the rim of something explained."""


@dataclass(frozen=True, eq=False)
class UnexplainedSpace:
    """Where something may be that no probable estimate explains, seen from one camera over the floor at z = 0."""

    camera: Pinhole
    T_world_camera: Float[np.ndarray, "4 4"]
    pixels: Bool[np.ndarray, "height width"]
    """Of the foreground, those outside of the outlines of all estimates that explain something."""
    outlines: tuple[Bool[np.ndarray, "height width"], ...]
    """Of each estimate, probable or not, with a margin."""
    trusted: frozenset[int]
    """Estimates that may be grasped, and that rule out what would meet them."""
    height_m: float
    """How high it may reach."""

    @staticmethod
    def of(
        foreground: Bool[np.ndarray, "height width"],
        camera: Pinhole,
        T_world_camera: Float[np.ndarray, "4 4"],
        parts: Sequence[Part],
        Ts_world_part: Sequence[Float[np.ndarray, "4 4"]],
        scores: Sequence[float],
        rim_m: float,
    ) -> UnexplainedSpace:
        """Return what these estimates leave unexplained.

        It is no higher than the highest probable estimate, nor than the bin's rim at `rim_m`.
        """
        T_camera_world = invert(T_world_camera)
        points = [transform_points(T, surface_points(part)) for part, T in zip(parts, Ts_world_part, strict=True)]
        outlines = tuple(
            outline(transform_points(T_camera_world, own), point_spacing_m(part), camera)
            for own, part in zip(points, parts, strict=True)
        )
        pixels = foreground.copy()
        for k, score in enumerate(scores):
            if score >= EXPLAINING_SCORE:
                pixels &= ~outlines[k]
        narrow = np.ones((_NOISE_PX, _NOISE_PX), np.uint8)
        pixels = cv2.morphologyEx(pixels.astype(np.uint8), cv2.MORPH_OPEN, narrow).astype(bool)
        probable = frozenset(k for k, score in enumerate(scores) if score >= TRUSTED_SCORE)
        highest_m = max((float(points[k][:, 2].max()) for k in probable), default=rim_m)
        # Where all are improbable, one of them is still the best guess.
        trusted = probable or frozenset(range(len(parts)))
        return UnexplainedSpace(camera, T_world_camera, pixels, outlines, trusted, min(highest_m, rim_m))

    def around(self, target: int) -> Float[np.ndarray, "n 3"]:
        """Return points in the world that fill it, without what may be the estimate `target` itself."""
        pixels = self.pixels & ~self.outlines[target]
        return columns_over_floor(pixels, self.camera, self.T_world_camera, self.height_m)


def outline(
    points_camera: Float[np.ndarray, "n 3"], spacing_m: float, camera: Pinhole
) -> Bool[np.ndarray, "height width"]:
    """Return the pixels that a surface, given by points and their spacing, covers, with a margin of 3 px."""
    image = np.zeros((camera.height, camera.width), np.uint8)
    seen = points_camera[points_camera[:, 2] > 1e-3]
    columns, rows = np.floor(np.clip(camera.project(seen), -1, 1e6)).astype(int).T
    inside = (rows >= 0) & (columns >= 0) & (rows < camera.height) & (columns < camera.width)
    if not inside.any():
        return image.astype(bool)
    image[rows[inside], columns[inside]] = 1
    gap_px = min(int(np.ceil(spacing_m * camera.fx / float(np.median(seen[:, 2])))), *image.shape)
    # A border, because closing erodes from the image's edge.
    padded = cv2.copyMakeBorder(image, gap_px, gap_px, gap_px, gap_px, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((2 * gap_px + 1,) * 2, np.uint8))
    grown = cv2.dilate(closed, np.ones((2 * _MARGIN_PX + 1,) * 2, np.uint8))
    return grown[gap_px:-gap_px, gap_px:-gap_px].astype(bool)


def columns_over_floor(
    pixels: Bool[np.ndarray, "height width"],
    camera: Pinhole,
    T_world_camera: Float[np.ndarray, "4 4"],
    height_m: float,
) -> Float[np.ndarray, "n 3"]:
    """Return points in the world on the lines of sight of every fourth pixel, from the floor up to `height_m`."""
    first = _STRIDE_PX // 2
    rows, columns = np.nonzero(pixels[first::_STRIDE_PX, first::_STRIDE_PX])
    u, v = _STRIDE_PX * columns + first + 0.5, _STRIDE_PX * rows + first + 0.5
    sights = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(len(u))], axis=1)
    sights = sights @ T_world_camera[:3, :3].T
    sights = sights[sights[:, 2] < -0.1]
    eye_m = T_world_camera[:3, 3]
    heights_m = np.arange(0.0, height_m + 1e-9, _STEP_M)
    lengths = (heights_m - eye_m[2]) / sights[:, 2:]
    return (eye_m + sights[:, None] * lengths[..., None]).reshape(-1, 3)
