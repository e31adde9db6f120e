"""A part's surface for grasp sampling: evenly drawn points with normals, and ray casting."""

from __future__ import annotations

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float

from simpick.assets.mjcf import VISUAL_GROUP, add_part
from simpick.assets.part import Part

_STEP_OFF_M = 1e-6


class PartSurface:
    """Points and outward normals drawn evenly over a part's mesh, and rays against that mesh (part frame)."""

    def __init__(self, part: Part, points: int = 4000, seed: int = 0) -> None:
        self.part = part
        drawn, faces = trimesh.sample.sample_surface(part.mesh, points, seed=seed)[:2]
        self.points: Float[np.ndarray, "n 3"] = np.asarray(drawn, float)
        self.normals: Float[np.ndarray, "n 3"] = np.asarray(part.mesh.face_normals, float)[faces]
        self.area_per_point_m2 = float(part.mesh.area) / points
        self.centre_of_mass_m: Float[np.ndarray, "3"] = np.asarray(part.solid.center_mass, float)
        # MuJoCo's rays use a bounding volume hierarchy, which neither trimesh nor a loop over triangles offers.
        spec = mujoco.MjSpec()
        add_part(spec, part, "part", free=False, collide=False)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._groups = np.zeros(mujoco.mjNGROUP, np.uint8)
        self._groups[VISUAL_GROUP] = 1

    def cast(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
        """Return distance to the first surface met by each ray (infinite if none) and that surface's normal."""
        distances = np.full(len(origins), np.inf)
        normals = np.zeros((len(origins), 3))
        geom = np.zeros(1, np.int32)
        normal = np.zeros(3)
        for k, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
            distance = mujoco.mj_ray(self._model, self._data, origin, direction, self._groups, 1, -1, geom, normal)
            if distance >= 0:
                distances[k], normals[k] = distance, normal
        return distances, normals

    def crossings(
        self, origin: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"], limit: int = 8
    ) -> list[tuple[float, Float[np.ndarray, "3"]]]:
        """Return up to `limit` crossings of one ray with the surface as (distance, normal), nearest first."""
        found: list[tuple[float, Float[np.ndarray, "3"]]] = []
        travelled = 0.0
        for _ in range(limit):
            (distance,), (normal,) = self.cast((origin + travelled * direction)[None], direction[None])
            if not np.isfinite(distance):
                break
            travelled += float(distance)
            found.append((travelled, normal))
            travelled += _STEP_OFF_M
        return found
