"""Symmetry groups of parts: discrete and continuous rigid motions that map a part onto itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError
from simpick.geometry.transforms import rotation_angle, skew, so3_exp, transform


@dataclass(frozen=True)
class ContinuousSymmetry:
    """Any rotation about `axis` through `offset_m` (both in the part frame) maps the part onto itself."""

    axis: tuple[float, float, float]
    """Direction; normalized to unit length."""
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """A point on the axis."""

    @staticmethod
    def of(axis: Float[np.ndarray, "3"], offset_m: Float[np.ndarray, "3"]) -> ContinuousSymmetry:
        """Return the symmetry of these vectors."""
        return ContinuousSymmetry(tuple(axis.tolist()), tuple(offset_m.tolist()))

    def __post_init__(self) -> None:
        norm = np.linalg.norm(self.axis)
        if not (np.isfinite(norm) and norm > 1e-9 and np.isfinite(self.offset_m).all()):
            raise ConfigError(f"a symmetry needs a finite axis that is not zero, got {self.axis} at {self.offset_m}")
        x, y, z = (float(a / norm) for a in self.axis)
        object.__setattr__(self, "axis", (x, y, z))

    def rotation(self, angle_rad: Float[np.ndarray, "*batch"] | float) -> Float[np.ndarray, "*batch 4 4"]:
        """Return the transforms that rotate the part by these angles about the axis."""
        R = so3_exp(np.asarray(angle_rad)[..., None] * np.asarray(self.axis))
        offset = np.asarray(self.offset_m)
        return transform(R, offset - R @ offset)


@dataclass(frozen=True, eq=False)
class SymmetryGroup:
    """The rigid motions of the part frame that leave the part unchanged, as BOP's ``models_info`` lists them.

    `discrete` holds every discrete element *except* the identity; `continuous` the axes of rotation. The group
    consists of all products of a continuous rotation with a discrete element (or the identity). Axes in two or more
    directions make the part a ball: every rotation about their common point belongs to the group.
    """

    discrete: Float[np.ndarray, "n 4 4"] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    continuous: tuple[ContinuousSymmetry, ...] = ()

    def __post_init__(self) -> None:
        if self.discrete.ndim != 3 or self.discrete.shape[1:] != (4, 4):
            raise ConfigError(f"discrete symmetries must have shape (n, 4, 4), got {self.discrete.shape}")
        R = self.discrete[:, :3, :3]
        # Loose, because published data sets round their symmetries to a few digits.
        rigid = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0.0) < 1e-2
        proper = bool((np.linalg.det(R) > 0).all())
        affine = np.array_equal(self.discrete[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (len(R), 1)))
        if not (np.isfinite(self.discrete).all() and rigid and proper and affine):
            raise ConfigError(
                "discrete symmetries must be rigid motions (rotation with determinant +1 and a translation in m); "
                "a mirror image is not a symmetry of a solid part"
            )

    @staticmethod
    def cyclic(order: int, axis: tuple[float, float, float] = (0.0, 0.0, 1.0), *, flips: bool = False) -> SymmetryGroup:
        """Return the rotations by 2 pi / `order` about `axis`; `flips` adds half turns about normal axes (dihedral)."""
        if order < 1:
            raise ConfigError(f"order of a cyclic group must be 1 or more, got {order}")
        angles = 2 * np.pi * np.arange(order) / order
        axis = ContinuousSymmetry(axis).axis
        Rs = so3_exp(angles[:, None] * np.asarray(axis))
        if flips:
            Rs = np.concatenate([Rs, Rs @ so3_exp(np.pi * _normal_to(axis))])
        return SymmetryGroup(transform(Rs)[1:])

    @staticmethod
    def revolution(axis: tuple[float, float, float] = (0.0, 0.0, 1.0), *, flip: bool = False) -> SymmetryGroup:
        """Return all rotations about `axis`; `flip` adds the half turn that swaps its two ends."""
        continuous = ContinuousSymmetry(axis)
        discrete = transform(so3_exp(np.pi * _normal_to(continuous.axis)))[None] if flip else np.zeros((0, 4, 4))
        return SymmetryGroup(discrete, (continuous,))

    @property
    def is_trivial(self) -> bool:
        """Return whether only the identity maps the part onto itself."""
        return len(self.discrete) == 0 and not self.continuous

    @cached_property
    def is_ball(self) -> bool:
        """Return whether continuous axes in different directions make every rotation a symmetry."""
        axes = np.array([s.axis for s in self.continuous]).reshape(-1, 3)
        return len(axes) > 1 and bool(np.linalg.norm(np.cross(axes[0], axes), axis=-1).max() > 1e-6)

    @cached_property
    def with_identity(self) -> Float[np.ndarray, "n 4 4"]:
        """Return the discrete elements, identity first."""
        return np.concatenate([np.eye(4)[None], self.discrete])

    def transforms(self, steps: int = 64) -> Float[np.ndarray, "m 4 4"]:
        """Return the whole group, identity first, with `steps` equal rotations about each continuous axis."""
        if not self.continuous:
            return self.with_identity
        angles = 2 * np.pi * np.arange(steps) / steps
        return np.concatenate(
            [(s.rotation(angles)[:, None] @ self.with_identity[None]).reshape(-1, 4, 4) for s in self.continuous]
        )

    def transforms_by_step(self, max_step: float = 0.01) -> Float[np.ndarray, "m 4 4"]:
        """Return the whole group, discretized so that no point moves more than `max_step` between neighbours.

        `max_step` is a fraction of the diameter. As in the BOP toolkit, the farthest point is assumed at half the
        diameter from the axis, hence ceil(pi / max_step) rotations: 315 for BOP's 0.01.
        """
        if not 0 < max_step <= 1:
            raise ConfigError(f"max_step must be a fraction of the diameter in (0, 1], got {max_step}")
        return self.transforms(int(np.ceil(np.pi / max_step)))

    def closest_equivalent(
        self, T_a_part: Float[np.ndarray, "*#batch 4 4"], T_a_reference: Float[np.ndarray, "*#batch 4 4"]
    ) -> Float[np.ndarray, "*batch 4 4"]:
        """Return ``T_a_part @ S``, with the symmetry S that minimizes the rotation to `T_a_reference`.

        Exact for continuous axes too: with M = D R_reference^T R_part and the axis n, the trace of M exp(t n) is
        cos t (tr M - n M n) + sin t tr(M [n]x) + n M n, largest at t = atan2(tr(M [n]x), tr M - n M n).
        """
        batch = np.broadcast_shapes(T_a_part.shape[:-2], T_a_reference.shape[:-2])
        T_a_part = np.broadcast_to(T_a_part, (*batch, 4, 4))
        R_part_reference = np.swapaxes(T_a_part[..., :3, :3], -1, -2) @ T_a_reference[..., :3, :3]
        return T_a_part @ self.closest_symmetry(R_part_reference)

    def rotation_distance(
        self, R_a_part: Float[np.ndarray, "*#batch 3 3"], R_a_reference: Float[np.ndarray, "*#batch 3 3"]
    ) -> Float[np.ndarray, "*batch"]:
        """Return the smallest angle in radians between two orientations over the part's symmetries."""
        R_part_reference = np.swapaxes(R_a_part, -1, -2) @ R_a_reference
        S = self.closest_symmetry(R_part_reference)[..., :3, :3]
        return rotation_angle(np.swapaxes(S, -1, -2) @ R_part_reference)

    def closest_symmetry(self, R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4 4"]:
        """Return the element of the group whose rotation is closest to R; ties go to the first, the identity."""
        if self.is_ball:
            return transform(R, self._ball_centre - R @ self._ball_centre)
        D = self.with_identity
        if not self.continuous:
            # tr(R^T D) is the elementwise product.
            return D[np.argmax(np.einsum("...ij,nij->...n", R, D[:, :3, :3]), axis=-1)]
        symmetry = self.continuous[0]
        n = np.asarray(symmetry.axis)
        M = D[:, :3, :3] @ np.swapaxes(R, -1, -2)[..., None, :, :]
        along = np.einsum("i,...ij,j->...", n, M, n)
        cosine = np.trace(M, axis1=-2, axis2=-1) - along
        sine = np.einsum("...ij,ji->...", M, skew(n))
        best = np.argmax(np.hypot(cosine, sine) + along, axis=-1)[..., None]
        angle = np.take_along_axis(np.arctan2(sine, cosine), best, axis=-1)[..., 0]
        return symmetry.rotation(angle) @ D[best[..., 0]]

    @cached_property
    def _ball_centre(self) -> Float[np.ndarray, "3"]:
        """Return the point closest to all continuous axes."""
        axes = np.array([s.axis for s in self.continuous])
        offsets = np.array([s.offset_m for s in self.continuous])
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        return np.linalg.solve(across.sum(0), (across @ offsets[..., None]).sum(0)[:, 0])


def _normal_to(axis: tuple[float, float, float]) -> Float[np.ndarray, "3"]:
    """Return a unit vector normal to the unit vector `axis`: the projection of x, or else of y or z."""
    a = np.asarray(axis, float)
    for candidate in np.eye(3):
        normal = candidate - a * (a @ candidate)
        if np.linalg.norm(normal) > 0.5:
            return normal / np.linalg.norm(normal)
    raise ConfigError(f"symmetry axis must be a unit vector, got {axis}")
