"""What renderers of single parts have in common: `PartRenderer` draws by OpenGL, `RayDepthRenderer` by ray casting."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from simpick.geometry import Pinhole


@dataclass(frozen=True, eq=False)
class PartViews:
    """A batch of images of one part."""

    rgb: UInt8[np.ndarray, "n height width 3"] | None
    """Black where the part is not; None if not asked for."""
    depth_m: Float32[np.ndarray, "n height width"]
    """Distance along the optical axis in metres; 0 where the part is not."""

    @property
    def masks(self) -> Bool[np.ndarray, "n height width"]:
        """Return the part's silhouettes: pixels whose centre it covers."""
        return self.depth_m > 0


@runtime_checkable
class PartDepthRenderer(Protocol):
    """Renders one part in any pose through any pinhole."""

    gives_colours: bool
    """Whether `render` may be asked for colours."""

    def render(
        self,
        Ts_camera_part: Float[np.ndarray, "n 4 4"],
        cameras: Pinhole | Sequence[Pinhole],
        *,
        rgb: bool,
        progress: Callable[[int, int], None] | None = None,
    ) -> PartViews:
        """Return one image for each pose, through one camera or through one each, all of the same size."""
        ...

    def close(self) -> None:
        """Free what it holds; may be called again."""
        ...
