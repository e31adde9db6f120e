"""`CropRenderer`: maps of posed parts in virtual cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int, UInt8

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.estimators.refiner.rendered_maps import RenderedMaps, rendered_maps
from simpick.geometry import VirtualCameras
from simpick.rendering import RenderQuality
from simpick.rendering.luminance import LUMINANCE
from simpick.rendering.part_renderers import PartRenderers

_SHARP = RenderQuality(shadow_map_px=0, samples=0)
_DARKEST = 5.0
"""A mean luminance below this, of 255, counts as this."""


class CropRenderer(Closing):
    """Renders depth, and the colours of parts that have some, and derives the maps; keeps one OpenGL context per part.

    A context manager.
    """

    def __init__(self, renderers: int, largest_px: int) -> None:
        """Keep at most `renderers` contexts, for crops of at most `largest_px`."""
        self._renderers = PartRenderers(renderers, quality=_SHARP, shaded=False)
        self._largest_px = largest_px

    def maps(
        self, parts: Sequence[Part], cameras: VirtualCameras, Ts_crop_part: Float[np.ndarray, "n 4 4"]
    ) -> RenderedMaps:
        """Return the maps of n poses, each of its own part in its own camera."""
        depth_m = np.empty((len(parts), cameras.size_px, cameras.size_px), np.float32)
        albedo = np.ones_like(depth_m)
        for part, rows in rows_by_part(parts):
            renderer = self._renderers.get(part, self._largest_px, self._largest_px)
            pinholes = [cameras.pinhole(k) for k in rows.tolist()]
            # Rays, where OpenGL does not work, give no colours: such parts are taken for parts of one colour.
            coloured = part.face_rgb is not None and renderer.gives_colours
            views = renderer.render(Ts_crop_part[rows], pinholes, rgb=coloured)
            depth_m[rows] = views.depth_m
            if views.rgb is not None:
                albedo[rows] = _relative_luminance(views.rgb, views.masks)
        origin_m = torch.from_numpy(Ts_crop_part[:, 2, 3]).float()
        focal_px = torch.from_numpy(cameras.focal_px).float()
        with torch.inference_mode():
            return rendered_maps(torch.from_numpy(depth_m), origin_m, focal_px, torch.from_numpy(albedo))

    def close(self) -> None:
        """Free the OpenGL contexts; may be called repeatedly."""
        self._renderers.close()


def _relative_luminance(
    rgb: UInt8[np.ndarray, "n size size 3"], masks: Bool[np.ndarray, "n size size"]
) -> Float32[np.ndarray, "n size size"]:
    """Return the luminance over its mean within the mask; 1 outside."""
    luminance = rgb @ np.array(LUMINANCE, np.float32)
    mean = luminance.sum(axis=(1, 2), where=masks) / np.maximum(masks.sum(axis=(1, 2)), 1)
    return np.where(masks, luminance / np.maximum(mean, _DARKEST)[:, None, None], 1).astype(np.float32)


def rows_by_part(parts: Sequence[Part]) -> list[tuple[Part, Int[np.ndarray, "_"]]]:
    """Return each of these parts once, with the positions that it has among them."""
    rows: dict[str, list[int]] = {}
    for k, part in enumerate(parts):
        rows.setdefault(part.name, []).append(k)
    return [(parts[own[0]], np.array(own)) for own in rows.values()]
