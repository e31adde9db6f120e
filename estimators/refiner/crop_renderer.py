"""`CropRenderer`: maps of posed parts in virtual cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.estimators.refiner.rendered_maps import RenderedMaps, rendered_maps
from simpick.geometry import VirtualCameras
from simpick.rendering import RenderQuality
from simpick.rendering.part_renderers import PartRenderers

_DEPTH_ONLY = RenderQuality(shadow_map_px=0, samples=0)


class CropRenderer(Closing):
    """Renders depth and derives the maps; keeps one OpenGL context per part. A context manager."""

    def __init__(self, renderers: int, largest_px: int) -> None:
        """Keep at most `renderers` contexts, for crops of at most `largest_px`."""
        self._renderers = PartRenderers(renderers, quality=_DEPTH_ONLY)
        self._largest_px = largest_px

    def maps(
        self, parts: Sequence[Part], cameras: VirtualCameras, Ts_crop_part: Float[np.ndarray, "n 4 4"]
    ) -> RenderedMaps:
        """Return the maps of n poses, each of its own part in its own camera."""
        depth_m = np.empty((len(parts), cameras.size_px, cameras.size_px), np.float32)
        for part, rows in rows_by_part(parts):
            renderer = self._renderers.get(part, self._largest_px, self._largest_px)
            pinholes = [cameras.pinhole(k) for k in rows.tolist()]
            depth_m[rows] = renderer.render(Ts_crop_part[rows], pinholes, rgb=False).depth_m
        origin_m = torch.from_numpy(Ts_crop_part[:, 2, 3]).float()
        focal_px = torch.from_numpy(cameras.focal_px).float()
        with torch.inference_mode():
            return rendered_maps(torch.from_numpy(depth_m), origin_m, focal_px)

    def close(self) -> None:
        """Free the OpenGL contexts; may be called repeatedly."""
        self._renderers.close()


def rows_by_part(parts: Sequence[Part]) -> list[tuple[Part, Int[np.ndarray, "k"]]]:
    """Return each of these parts once, with the positions that it has among them."""
    rows: dict[str, list[int]] = {}
    for k, part in enumerate(parts):
        rows.setdefault(part.name, []).append(k)
    return [(parts[own[0]], np.array(own)) for own in rows.values()]
