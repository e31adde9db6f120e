"""`EvaluationModel`: the vertices, diameter and symmetries of a part that pose errors depend on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from simpick.assets.part import Part
from simpick.errors import MeshError
from simpick.geometry import SymmetryGroup, farthest_points


@dataclass(frozen=True, eq=False)
class EvaluationModel:
    """The geometry that pose errors depend on. Symmetries and search tree are computed once per object."""

    name: str
    """The part's name, or a BOP data set's obj_id as text."""
    vertices_m: Float[np.ndarray, "n 3"]
    """Vertices in the part frame: for a BOP data set, those of ``models_eval``."""
    diameter_m: float
    """Largest distance between two vertices: for a BOP data set, as ``models_info`` states it."""
    symmetries: SymmetryGroup
    max_symmetry_step: float = 0.01
    """Largest displacement between neighbouring rotations about a continuous axis, as a fraction of the diameter."""

    def __post_init__(self) -> None:
        if len(self.vertices_m) == 0 or not np.isfinite(self.vertices_m).all():
            raise MeshError(f"model {self.name!r} must have finite vertices, got {len(self.vertices_m)} of them")
        if not (np.isfinite(self.diameter_m) and self.diameter_m > 0):
            raise MeshError(f"the diameter of model {self.name!r} must be positive, got {self.diameter_m} m")

    @staticmethod
    def of(part: Part) -> EvaluationModel:
        """Return a part's evaluation model."""
        return EvaluationModel(part.name, np.asarray(part.mesh.vertices, float), part.diameter_m, part.symmetries)

    @cached_property
    def symmetry_transforms(self) -> Float[np.ndarray, "m 4 4"]:
        """Return the part's symmetries, continuous ones discretized as in the BOP toolkit."""
        return self.symmetries.transforms_by_step(self.max_symmetry_step)

    @cached_property
    def spread_vertices(self) -> Int[np.ndarray, "k"]:
        """Return indices of a few vertices far from each other, some of which move in any motion of the part."""
        return farthest_points(self.vertices_m, min(16, len(self.vertices_m)))

    @cached_property
    def tree(self) -> KDTree:
        """Return a search tree over the vertices."""
        return KDTree(self.vertices_m)
