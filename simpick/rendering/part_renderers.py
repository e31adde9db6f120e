"""`PartRenderers`: a least-recently-used cache of renderers of depth and colour, one per part and image size."""

from __future__ import annotations

from collections import OrderedDict

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.rendering.part_depth import PartDepthRenderer
from simpick.rendering.quality import PART_QUALITY, RenderQuality
from simpick.rendering.ray_depth import RayDepthRenderer, depth_needs_rays


class PartRenderers(Closing):
    """Keeps at most `count` renderers open: of OpenGL, or where that does not work of Embree, if it is installed."""

    def __init__(self, count: int, *, quality: RenderQuality = PART_QUALITY, shaded: bool = True) -> None:
        self._count, self._quality, self._shaded = count, quality, shaded
        self._renderers: OrderedDict[tuple[str, int, int], PartDepthRenderer] = OrderedDict()

    def get(self, part: Part, height: int, width: int) -> PartDepthRenderer:
        """Return the renderer of a part for depth images of at most this size; it may be closed by the next call.

        Raises:
            RenderingUnavailableError: neither OpenGL nor Embree works here.
        """
        key = part.content_hash, height, width
        if key not in self._renderers:
            while len(self._renderers) >= self._count:
                self._renderers.popitem(last=False)[1].close()
            self._renderers[key] = self._open(part, height, width)
        self._renderers.move_to_end(key)
        return self._renderers[key]

    def close(self) -> None:
        """Free all OpenGL contexts; may be called again, and `get` makes new ones."""
        while self._renderers:
            self._renderers.popitem()[1].close()

    def _open(self, part: Part, height: int, width: int) -> PartDepthRenderer:
        if depth_needs_rays():
            return RayDepthRenderer(part)
        # Only here, because rays do without MuJoCo.
        from simpick.rendering.part_views import PartRenderer

        return PartRenderer(part, height, width, quality=self._quality, shaded=self._shaded)
