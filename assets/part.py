"""`Part`: shape, mass, symmetry and appearance of one kind of object."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import Float, UInt8

from simpick.errors import MeshError
from simpick.geometry.symmetry import SymmetryGroup


@dataclass(frozen=True)
class Material:
    """Appearance of a part, in MuJoCo's material terms."""

    rgb: tuple[float, float, float] = (0.6, 0.6, 0.62)
    specular: float = 0.5
    shininess: float = 0.5
    reflectance: float = 0.0


@dataclass(frozen=True, eq=False)
class Part:
    """One kind of part. The frame's origin is the centre of the mesh's axis-aligned bounding box."""

    name: str
    """Unique; letters, digits and underscores."""
    mesh: trimesh.Trimesh
    """Visual mesh in metres, watertight, in the part frame."""
    collision: tuple[trimesh.Trimesh, ...]
    """Convex pieces in the part frame that approximate the mesh in contact."""
    symmetries: SymmetryGroup = field(default_factory=SymmetryGroup)
    density_kg_m3: float = 1200.0
    material: Material = Material()
    T_cad_part: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))
    """Leads from the part frame to the frame of the CAD file, in metres: ``T_camera_cad = T_camera_part @
    invert(T_cad_part)``."""
    metres_per_cad_unit: float = 1.0
    """Unit of the CAD file's coordinates: 0.001 for millimetres."""
    face_rgb: UInt8[np.ndarray, "faces 3"] | None = None
    """Colour of each face of the mesh, in place of the material's; None for parts of one colour."""

    def __post_init__(self) -> None:
        centre = self.mesh.bounds.mean(axis=0)
        if np.abs(centre).max() > 1e-6:
            raise MeshError(f"part {self.name!r} must be centred on its bounding box, is off by {centre} m")
        if not self.collision:
            raise MeshError(f"part {self.name!r} needs at least one convex collision piece")

    @cached_property
    def mass_kg(self) -> float:
        """Return density times the solid's volume."""
        return float(self.density_kg_m3 * self.solid.volume)

    @cached_property
    def solid(self) -> trimesh.Trimesh:
        """Return what mass and inertia are computed from: the mesh, or its hull where the mesh bounds no volume.

        Scanned models, as in BOP's data sets, have holes.
        """
        return self.mesh if self.mesh.is_volume else self.mesh.convex_hull

    @cached_property
    def diameter_m(self) -> float:
        """Return the largest distance between two vertices, as BOP's ``models_info`` defines it."""
        hull = self.mesh.convex_hull.vertices
        return float(np.sqrt(((hull[:, None] - hull[None]) ** 2).sum(-1).max()))

    @cached_property
    def extents_m(self) -> Float[np.ndarray, "3"]:
        """Return the side lengths of the axis-aligned bounding box."""
        return np.asarray(self.mesh.extents)

    @cached_property
    def content_hash(self) -> str:
        """Return a hash of shape, mass, material and symmetry: the key of every cache about this part."""
        digest = hashlib.sha256()
        for mesh in (self.mesh, *self.collision):
            digest.update(np.ascontiguousarray(mesh.vertices, "<f8").tobytes())
            digest.update(np.ascontiguousarray(mesh.faces, "<i8").tobytes())
        digest.update(np.ascontiguousarray(self.symmetries.transforms(8), "<f8").tobytes())
        digest.update(repr((self.density_kg_m3, self.material)).encode())
        if self.face_rgb is not None:
            digest.update(np.ascontiguousarray(self.face_rgb).tobytes())
        return digest.hexdigest()[:16]
