"""Finding a mesh's rotational symmetries: candidates from its inertia, each verified against its surface.

Every self-map of a solid keeps its centre of mass and its inertia. So an axis of symmetry is a principal axis, or,
where two moments are equal, perhaps a half turn about some axis of their plane, or, where all three are equal,
any direction at all; the latter two are scanned. A candidate counts when every test point of the surface, carried
by it, lands on the surface within the tolerance.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import KDTree

from simpick.assets.surface import SurfaceDistance
from simpick.geometry.symmetry import ContinuousSymmetry, SymmetryGroup
from simpick.geometry.transforms import random_rotation, rotation_angle, so3_exp, so3_log, transform

RELATIVE_TOLERANCE = 0.006
"""Default tolerance over the diameter: above the facets of a usual tessellation, below a keyway or a socket."""
MAX_ORDER = 40
"""Largest order of a discrete rotation that is looked for."""
_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)
_EQUAL_MOMENTS = 0.03
# Half the smallest angle between two elements of a group, so that errors of refined axes do not split one in two.
_SAME_ELEMENT_RAD = np.pi / MAX_ORDER
_TEST_POINTS = 1500
_DENSE_POINTS = 20000
# Angles that no rotation of an order up to MAX_ORDER comes near to.
_IRRATIONAL_RAD = (0.3712, 1.0193, 1.7711, 2.6537)


def detect_symmetries(mesh: trimesh.Trimesh, tolerance_m: float | None = None) -> SymmetryGroup:
    """Return the rotations that map a watertight mesh onto itself within `tolerance_m` (default: 0.6 % of its size).

    A sphere has more symmetries than any list: it is returned as all rotations about z times 161 tilts, so that some
    element lies within 11 degrees of any rotation (6 on average).
    """
    return _Detector(mesh, tolerance_m).detect()


def nearest_revolution(mesh: trimesh.Trimesh) -> tuple[SymmetryGroup, float]:
    """Return the revolution that is nearest to being a symmetry, and by how much (m) a turn moves the surface at most.

    The axis is a principal axis. The ends count as alike where swapping them moves the surface no farther.
    """
    detector = _Detector(mesh, None)
    axes = np.linalg.eigh(np.asarray(mesh.moment_inertia))[1].T
    found = [(detector.deviation(axis), k) for k, axis in enumerate(detector.snapped(axis) for axis in axes)]
    deviation, best = min(found)
    detector.tolerance = max(detector.tolerance, deviation)
    return detector.revolution(detector.snapped(axes[best])), deviation


class _Detector:
    """The mesh with what every check needs: test points, a search tree, the tolerance."""

    def __init__(self, mesh: trimesh.Trimesh, tolerance_m: float | None) -> None:
        self.mesh = mesh
        self.centre = np.asarray(mesh.center_mass)
        self.radius = float(np.linalg.norm(mesh.vertices - self.centre, axis=1).max())
        self.tolerance = RELATIVE_TOLERANCE * 2 * self.radius if tolerance_m is None else tolerance_m
        self.distance = SurfaceDistance(mesh)
        rng = np.random.default_rng(0)
        samples = _sample(mesh, _TEST_POINTS, seed=0)[0]
        vertices = np.asarray(mesh.vertices)
        if len(vertices) > _TEST_POINTS:
            vertices = vertices[rng.permutation(len(vertices))[:_TEST_POINTS]]
        points = np.concatenate([samples, vertices]) - self.centre
        self.points = points[rng.permutation(len(points))]
        dense, self.normals = _sample(mesh, _DENSE_POINTS, seed=1)
        self.dense = dense - self.centre
        self.tree = KDTree(self.dense)
        self.spacing = float(np.sqrt(mesh.area / _DENSE_POINTS))

    def is_symmetry(self, R: Float[np.ndarray, "3 3"]) -> bool:
        """Return whether this rotation about the centre of mass maps the surface onto itself."""
        # Most candidates are refused by a cheap query: no gap between dense samples is as wide as 3 spacings.
        rough = self.tree.query(self.points[:300] @ R.T)[0].max()
        if rough > self.tolerance + 3 * self.spacing:
            return False
        # Then a few points refuse, and only the survivors pay for all.
        for part in (slice(0, 120), slice(120, None)):
            if self.distance(self.points[part] @ R.T + self.centre).max() > self.tolerance:
                return False
        return True

    def deviation(self, axis: Float[np.ndarray, "3"]) -> float:
        """Return by how much turns about this axis move the surface at most, in m: exact only where it is small."""
        turned = [self.points[:400] @ so3_exp(angle * axis).T for angle in _IRRATIONAL_RAD]
        rough = float(max(self.tree.query(points)[0].max() for points in turned))
        if rough > 6 * self.tolerance + 3 * self.spacing:
            return rough
        return float(max(self.distance(points + self.centre).max() for points in turned))

    def misfit(self, R: Float[np.ndarray, "3 3"]) -> float:
        """Return the mean distance of moved points to the dense samples: a cheap, smooth stand-in for the test."""
        return float(self.tree.query(self.points[:300] @ R.T)[0].mean())

    def refined(self, R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
        """Return the rotation near R that fits the surface best: ICP to tangent planes, about the centre of mass."""
        for _ in range(15):
            moved = self.points[:800] @ R.T
            nearest = self.tree.query(moved)[1]
            normals = self.normals[nearest]
            # Linear in the small rotation w: normal . (moved + w x moved - nearest) = 0.
            A = np.cross(moved, normals)
            gap = np.sum((self.dense[nearest] - moved) * normals, axis=1)
            # Damping keeps a revolution, which fits at any angle, from drifting.
            w = np.linalg.solve(A.T @ A + 1e-4 * np.trace(A.T @ A) * np.eye(3), A.T @ gap)
            R = so3_exp(w) @ R
            if np.linalg.norm(w) < 1e-6:
                break
        return R

    def detect(self) -> SymmetryGroup:
        moments, axes = np.linalg.eigh(np.asarray(self.mesh.moment_inertia))
        near = np.diff(moments) < _EQUAL_MOMENTS * moments[-1]
        if near.all():
            if all(self.is_symmetry(R) for R in random_rotation(np.random.default_rng(1), (4,))):
                return self._sphere()
            axes_found = self._axes_anywhere()
        elif near.any():
            # The axis of the moment that differs, then half turns in the plane of the two equal ones.
            odd = 2 if near[0] else 0
            axes_found = self._axes_about(axes[:, odd])
        else:
            axes_found = [self.snapped(axis) for axis in axes.T]

        orders = [(axis, self._order(axis)) for axis in axes_found]
        continuous = [axis for axis, order in orders if order == 0]
        if continuous:
            return self.revolution(continuous[0])
        turns = [so3_exp(2 * np.pi / order * axis) for axis, order in orders if order > 1]
        Rs = _closure(turns)[1:]
        return SymmetryGroup(transform(Rs, self.centre - Rs @ self.centre))

    def _order(self, axis: Float[np.ndarray, "3"]) -> int:
        """Return how many rotations about this axis fit: 0 for all of them, 1 for the identity alone."""
        if all(self.is_symmetry(so3_exp(angle * axis)) for angle in _IRRATIONAL_RAD):
            return 0
        # The rotations about one axis form a cyclic group, so its order is found prime by prime.
        order = 1
        for prime in _PRIMES:
            while order * prime <= MAX_ORDER and self.is_symmetry(so3_exp(2 * np.pi / (order * prime) * axis)):
                order *= prime
        return order

    def _axes_about(self, main: Float[np.ndarray, "3"]) -> list[Float[np.ndarray, "3"]]:
        """Return the main axis and, of the directions normal to it, those whose half turn may fit."""
        main = self.snapped(main)
        first = _any_normal(main)
        second = np.cross(main, first)
        angles = np.radians(np.arange(0.0, 180.0, 1.0))
        directions = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
        misfits = np.array([self.misfit(so3_exp(np.pi * d)) for d in directions])
        # A local minimum, round the circle.
        minima = np.flatnonzero((misfits <= np.roll(misfits, 1)) & (misfits <= np.roll(misfits, -1)))
        best = minima[np.argsort(misfits[minima], kind="stable")][:6]
        flips = (self._refined_axis(directions[k], 2) for k in best)
        # With one flip, the turns about the main axis make the others.
        flip = next((axis for axis in flips if self.is_symmetry(so3_exp(np.pi * axis))), None)
        return [main] if flip is None else [main, flip]

    def _axes_anywhere(self) -> list[Float[np.ndarray, "3"]]:
        """Return the axes that fit, of directions all over the sphere: for cubes and for equal inertia by chance."""
        directions = _hemisphere(3)
        found: list[Float[np.ndarray, "3"]] = []
        for order in (2, 3, 5):
            misfits = np.array([self.misfit(so3_exp(2 * np.pi / order * d)) for d in directions])
            near = np.abs(directions @ directions.T) > np.cos(np.radians(12.0))
            minima = np.flatnonzero(misfits <= np.where(near, misfits, np.inf).min(axis=1))
            for k in minima[np.argsort(misfits[minima], kind="stable")][:16]:
                axis = self._refined_axis(directions[k], order)
                is_new = all(abs(axis @ other) < np.cos(np.radians(2.0)) for other in found)
                if is_new and self.is_symmetry(so3_exp(2 * np.pi / order * axis)):
                    found.append(axis)
        return found

    def _refined_axis(self, axis: Float[np.ndarray, "3"], order: int) -> Float[np.ndarray, "3"]:
        w = so3_log(self.refined(so3_exp(2 * np.pi / order * axis)))
        # Near pi the logarithm may point either way.
        refined = w / max(float(np.linalg.norm(w)), 1e-12) * (1.0 if w @ axis >= 0 else -1.0)
        # ICP may slide along a revolution and leave for the identity; then the start was as good.
        return self.snapped(refined if refined @ axis > np.cos(np.radians(10.0)) else axis)

    def snapped(self, axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Return the coordinate axis within a degree of this one, if there is one: CAD is drawn along axes."""
        k = int(np.argmax(np.abs(axis)))
        return np.eye(3)[k] if abs(axis[k]) > np.cos(np.radians(1.0)) else axis

    def revolution(self, axis: Float[np.ndarray, "3"]) -> SymmetryGroup:
        offset = self.centre - axis * (axis @ self.centre)
        continuous = ContinuousSymmetry.of(axis, offset)
        flip = so3_exp(np.pi * _any_normal(axis))
        flips = (
            transform(flip, self.centre - flip @ self.centre)[None] if self.is_symmetry(flip) else np.zeros((0, 4, 4))
        )
        return SymmetryGroup(flips, (continuous,))

    def _sphere(self) -> SymmetryGroup:
        directions = np.asarray(trimesh.creation.icosphere(subdivisions=2).vertices)
        directions = directions[directions[:, 2] < 1 - 1e-9]
        tilts = np.cross([0.0, 0.0, 1.0], directions)
        norm = np.linalg.norm(tilts, axis=1, keepdims=True)
        tilts = np.where(norm > 1e-9, tilts / np.maximum(norm, 1e-9), np.array([1.0, 0.0, 0.0]))
        Rs = so3_exp(tilts * np.arccos(np.clip(directions[:, 2:], -1.0, 1.0)))
        turn = ContinuousSymmetry.of(np.array([0.0, 0.0, 1.0]), self.centre * [1.0, 1.0, 0.0])
        return SymmetryGroup(transform(Rs, self.centre - Rs @ self.centre), (turn,))


def _closure(generators: Iterable[Float[np.ndarray, "3 3"]], limit: int = 120) -> Float[np.ndarray, "n 3 3"]:
    """Return the finite rotation group of these generators, identity first."""
    generators = list(generators)
    group = [np.eye(3)]
    k = 0
    while k < len(group) and len(group) < limit:
        for generator in generators:
            product = generator @ group[k]
            if rotation_angle(np.stack(group) @ product.T).min() > _SAME_ELEMENT_RAD:
                group.append(product)
        k += 1
    return np.stack(group)


def _hemisphere(subdivisions: int) -> Float[np.ndarray, "n 3"]:
    """Return directions over half a sphere, about 8 degrees apart at 3 subdivisions."""
    directions = np.asarray(trimesh.creation.icosphere(subdivisions=subdivisions).vertices)
    x, y, z = directions.T.round(9)
    return directions[(z > 0) | ((z == 0) & (y > 0)) | ((z == 0) & (y == 0) & (x > 0))]


def _sample(mesh: trimesh.Trimesh, count: int, seed: int) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Return points spread evenly over the surface, and the normals there."""
    result = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return np.asarray(result[0]), np.asarray(mesh.face_normals)[np.asarray(result[1])]


def _any_normal(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    normal = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    return normal / np.linalg.norm(normal)
