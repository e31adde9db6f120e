"""Points on the surface of a part, the same in every call."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import trimesh
from jaxtyping import Float

from simpick.assets.part import Part

_COUNT = 1500


@lru_cache(maxsize=64)
def surface_points(part: Part) -> Float[np.ndarray, "n 3"]:
    """Return 1500 points spread evenly at random over the part's surface."""
    return np.asarray(trimesh.sample.sample_surface(part.mesh, _COUNT, seed=0)[0], float)


def point_spacing_m(part: Part) -> float:
    """Return the side of the square that each of these points stands for."""
    return float(np.sqrt(part.mesh.area / _COUNT))
