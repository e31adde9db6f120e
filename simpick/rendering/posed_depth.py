"""Depth of single parts in given poses, for VSD: each rendered in a window that just encloses it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Int

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.geometry import Pinhole
from simpick.rendering.part_renderers import PartRenderers
from simpick.rendering.quality import RenderQuality

_MAX_RENDERERS = 32
"""OpenGL contexts kept open at once. Making one takes longer than rendering dozens of images, so mixed bins need one
per part of the library; each holds a few megabytes."""


class PosedDepthRenderer(Closing):
    """Renders depth of single parts and keeps its OpenGL contexts between calls. A context manager."""

    def __init__(self) -> None:
        # Depth is drawn without anti-aliasing; a buffer for it would only cost memory, much of it for large images.
        self._renderers = PartRenderers(_MAX_RENDERERS, quality=RenderQuality(shadow_map_px=0, samples=0))

    def render(
        self, part: Part, Ts_camera_part: Float[np.ndarray, "n 4 4"], camera: Pinhole
    ) -> Float32[np.ndarray, "n height width"]:
        """Return a depth image per pose, 0 outside the part; empty for poses behind the camera."""
        depth_m = np.zeros((len(Ts_camera_part), camera.height, camera.width), np.float32)
        ahead = np.flatnonzero(np.isfinite(Ts_camera_part).all((1, 2)) & (Ts_camera_part[:, 2, 3] > 0))
        radius_m = float(np.linalg.norm(part.mesh.vertices, axis=-1).max())
        corners, (width, height) = _windows(Ts_camera_part[ahead, :3, 3], radius_m, camera)
        size, image = np.array([width, height]), np.array([camera.width, camera.height])
        near_image = (corners + size > 0).all(1) & (corners < image).all(1)
        seen, corners = ahead[near_image], corners[near_image]
        if len(seen) == 0:
            return depth_m
        # Moved into the image, the window still encloses the part inside the image.
        corners = np.clip(corners, 0, image - size)
        windows = [
            Pinhole(width, height, camera.fx, camera.fy, camera.cx - float(x), camera.cy - float(y)) for x, y in corners
        ]
        renderer = self._renderers.get(part, camera.height, camera.width)
        views = renderer.render(Ts_camera_part[seen], windows, rgb=False).depth_m
        for k, (x, y), view in zip(seen, corners, views, strict=True):
            depth_m[k, y : y + height, x : x + width] = view
        return depth_m

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        self._renderers.close()


def _windows(
    centres_m: Float[np.ndarray, "n 3"], radius_m: float, camera: Pinhole
) -> tuple[Int[np.ndarray, "n 2"], tuple[int, int]]:
    """Return the upper left corners of windows that enclose spheres at `centres_m`, and the windows' common size.

    A point of a sphere with centre (X, Y, Z) and radius r projects at most f r (1 + |X| / Z) / (Z - r) from the
    projected centre along x, and likewise along y. Spheres that enclose the camera get the whole image.
    """
    image = np.array([camera.width, camera.height])
    z = centres_m[:, 2:]
    apart = z > 1.05 * radius_m
    z = np.where(apart, z, 1.0)
    middle = centres_m[:, :2] / z * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    reach = np.array([camera.fx, camera.fy]) * radius_m * (1 + np.abs(centres_m[:, :2]) / z)
    half = np.where(apart, reach / np.where(apart, z - radius_m, 1.0), image)
    middle = np.where(apart, middle, image / 2)
    size = np.minimum(np.ceil(2 * half.max(axis=0, initial=0.0)).astype(int) + 2, image)
    corners = np.floor(middle - size / 2).astype(int)
    # A window as large as the image is the image, wherever the part is.
    corners = np.where(size == image, np.clip(corners, 0, 0), corners)
    return corners, (int(size[0]), int(size[1]))
