"""Visibility of each part: the unoccluded share of its silhouette."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from simpick.geometry import Pinhole
from simpick.rendering.renderer import Viewpoint
from simpick.rendering.scene_renderer import SceneRenderer


@dataclass(frozen=True, eq=False)
class Visibility:
    """One instance in one image."""

    instance: int
    visible_px: int
    """Pixels in which the instance is seen."""
    silhouette_px: int
    """Pixels it would cover if nothing hid it and the image had no borders (BOP's ``px_count_all``)."""
    box_silhouette_xyxy_px: Float[np.ndarray, "4"]
    """Box of that silhouette: the amodal box. It may reach beyond the image."""
    window: Bool[np.ndarray, "rows columns"]
    """The silhouette within its box."""

    @property
    def fraction(self) -> float:
        """Return the visible share of the silhouette (BOP's ``visib_fract``); 0 where there is none."""
        return self.visible_px / self.silhouette_px if self.silhouette_px else 0.0

    def silhouette(self, height: int, width: int) -> Bool[np.ndarray, "height width"]:
        """Return the silhouette in an image of this size, hidden pixels included (BOP's ``mask``)."""
        mask = np.zeros((height, width), bool)
        x, y = self.box_silhouette_xyxy_px[:2].astype(int)
        rows, columns = self.window.shape
        top, left, bottom, right = max(y, 0), max(x, 0), min(y + rows, height), min(x + columns, width)
        if top < bottom and left < right:
            mask[top:bottom, left:right] = self.window[top - y : bottom - y, left - x : right - x]
        return mask


def measure_visibility(renderer: SceneRenderer, camera: str = "overhead") -> tuple[Visibility, ...]:
    """Return the visibility of every instance in front of the camera that projects into or near the image.

    One pass counts the visible pixels; then each instance is drawn alone, on the same pixel grid, in a window that
    just holds it: one small draw each. Instances outside the image are left out.
    """
    frame = renderer.capture(camera, rgb=False, depth=False)
    assert frame.instances is not None
    seen = np.bincount(frame.instances[frame.instances >= 0], minlength=len(renderer.scene.instance_of_geom))
    found = [
        measure_instance(renderer, k, int(seen[k]), frame.camera, frame.T_world_camera) for k in _instances(renderer)
    ]
    return tuple(visibility for visibility in found if visibility is not None)


def visible_fractions(renderer: SceneRenderer, camera: str = "overhead") -> dict[int, float]:
    """Return `Visibility.fraction` by instance; see `measure_visibility`."""
    return {v.instance: v.fraction for v in measure_visibility(renderer, camera)}


def _instances(renderer: SceneRenderer) -> list[int]:
    return [int(k) for k in np.unique(renderer.scene.instance_of_geom) if k >= 0]


def measure_instance(
    renderer: SceneRenderer,
    instance: int,
    visible_px: int,
    camera: Pinhole,
    T_world_camera: Float[np.ndarray, "4 4"],
) -> Visibility | None:
    """Return the visibility of one instance of which `visible_px` pixels are seen, by drawing it alone.

    None where it is not in front of the camera, or outside the image.
    """
    model, data = renderer.scene.model, renderer.scene.data
    geoms = np.flatnonzero((renderer.scene.instance_of_geom == instance) & (model.geom_group < 3))
    # The corners of the geoms' bounding boxes bound the projection.
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    corners = model.geom_aabb[geoms, None, :3] + signs * model.geom_aabb[geoms, None, 3:]
    Rs_world_geom = data.geom_xmat[geoms].reshape(-1, 3, 3)
    corners = (corners @ np.swapaxes(Rs_world_geom, -1, -2) + data.geom_xpos[geoms, None]).reshape(-1, 3)
    corners = (corners - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    if corners[:, 2].min() <= 0.02:
        return None
    pixels = camera.project(corners)
    low, high = np.floor(pixels.min(axis=0)).astype(int) - 1, np.ceil(pixels.max(axis=0)).astype(int) + 1
    if (high <= 0).any() or low[0] >= camera.width or low[1] >= camera.height:
        return None
    # The window may be larger than the image; it is cut to what the renderer holds, on the side away from the image.
    limit = np.array([renderer.renderer.width, renderer.renderer.height])
    low = np.maximum(low, np.minimum(high - limit, 0))
    high = np.minimum(high, low + limit)
    window_px = high - low
    window = Pinhole(
        int(window_px[0]), int(window_px[1]), camera.fx, camera.fy, camera.cx - float(low[0]), camera.cy - float(low[1])
    )
    alone = renderer.renderer.render(
        data, Viewpoint(window, T_world_camera), rgb=False, depth=True, only=[int(g) for g in geoms]
    ).depth_m
    assert alone is not None
    rows, columns = np.flatnonzero((alone > 0).any(axis=1)), np.flatnonzero((alone > 0).any(axis=0))
    if len(rows) == 0:
        return Visibility(instance, 0, 0, np.array([*low, *low], float), np.zeros((0, 0), bool))
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    box = np.array([low[0] + left, low[1] + top, low[0] + right, low[1] + bottom], float)
    silhouette = alone[top:bottom, left:right] > 0
    return Visibility(instance, visible_px, int(silhouette.sum()), box, silhouette)
