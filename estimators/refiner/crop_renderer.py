"""`CropRenderer`: maps of posed parts in virtual cameras."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

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

    def maps(self, part: Part, cameras: VirtualCameras, Ts_crop_part: Float[np.ndarray, "n 4 4"]) -> RenderedMaps:
        """Return the maps of one part in n poses, each in its own camera."""
        renderer = self._renderers.get(part, self._largest_px, self._largest_px)
        pinholes = [cameras.pinhole(k) for k in range(len(cameras))]
        depth_m = torch.from_numpy(renderer.render(Ts_crop_part, pinholes, rgb=False).depth_m)
        origin_m = torch.from_numpy(Ts_crop_part[:, 2, 3]).float()
        focal_px = torch.from_numpy(cameras.focal_px).float()
        with torch.inference_mode():
            return rendered_maps(depth_m, origin_m, focal_px)

    def close(self) -> None:
        """Free the OpenGL contexts; may be called repeatedly."""
        self._renderers.close()
