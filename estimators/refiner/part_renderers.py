"""`PartRenderers`: a least-recently-used cache of OpenGL renderers, one per part."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
from jaxtyping import Float, Float32

from simpick.assets.part import Part
from simpick.geometry import VirtualCameras
from simpick.rendering import PartRenderer, RenderQuality

_DEPTH_ONLY = RenderQuality(shadow_map_px=0, samples=0)


class PartRenderers:
    """Renders depth of parts with at most `count` OpenGL contexts."""

    def __init__(self, count: int, size_px: int) -> None:
        """Render crops of at most `size_px`."""
        self._count, self._size_px = count, size_px
        self._renderers: OrderedDict[str, PartRenderer] = OrderedDict()

    def depth(
        self, part: Part, Ts_crop_part: Float[np.ndarray, "n 4 4"], cameras: VirtualCameras
    ) -> Float32[np.ndarray, "n size size"]:
        """Return depth in metres of the part in each pose through the camera of the same row; 0 beside it."""
        pinholes = [cameras.pinhole(k) for k in range(len(cameras))]
        return self._renderer(part).render(Ts_crop_part, pinholes, rgb=False).depth_m

    def close(self) -> None:
        """Free all contexts; may be called repeatedly, and rendering afterwards makes new ones."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()

    def _renderer(self, part: Part) -> PartRenderer:
        key = part.content_hash
        if key not in self._renderers:
            while len(self._renderers) >= self._count:
                self._renderers.popitem(last=False)[1].close()
            self._renderers[key] = PartRenderer(part, self._size_px, self._size_px, quality=_DEPTH_ONLY)
        self._renderers.move_to_end(key)
        return self._renderers[key]
