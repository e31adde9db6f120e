"""Symmetry groups of parts: which poses cannot be told apart, discretely and about continuous axes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError
from simpick.geometry.transforms import so3_exp, transform


@dataclass(frozen=True)
class ContinuousSymmetry:
    """Any rotation about `axis` through `offset_m` (both in the part frame) maps the part onto itself."""

    axis: tuple[float, float, float]
    """Unit vector."""
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """A point on the axis."""

    def rotation(self, angle_rad: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 4 4"]:
        """Return the part's self-maps by these angles."""
        R = so3_exp(np.asarray(angle_rad)[..., None] * np.asarray(self.axis))
        offset = np.asarray(self.offset_m)
        return transform(R, offset - R @ offset)


@dataclass(frozen=True)
class SymmetryGroup:
    """The rigid motions of the part frame that leave the part unchanged, as BOP's ``models_info`` lists them.

    `discrete` holds every discrete element *besides* the identity; `continuous` the axes of rotation. The group
    is all products of a continuous rotation with a discrete element (or the identity).
    """

    discrete: Float[np.ndarray, "n 4 4"] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    continuous: tuple[ContinuousSymmetry, ...] = ()

    def __post_init__(self) -> None:
        if self.discrete.ndim != 3 or self.discrete.shape[1:] != (4, 4):
            raise ConfigError(f"discrete symmetries must have shape (n, 4, 4), got {self.discrete.shape}")

    @staticmethod
    def cyclic(order: int, axis: tuple[float, float, float] = (0.0, 0.0, 1.0), *, flips: bool = False) -> SymmetryGroup:
        """Return the rotations by 2 pi / `order` about `axis`; `flips` adds half turns about normal axes (dihedral)."""
        angles = 2 * np.pi * np.arange(order) / order
        Rs = so3_exp(angles[:, None] * np.asarray(axis))
        if flips:
            Rs = np.concatenate([Rs, Rs @ so3_exp(np.pi * _normal_to(axis))])
        return SymmetryGroup(transform(Rs)[1:])

    @staticmethod
    def revolution(axis: tuple[float, float, float] = (0.0, 0.0, 1.0), *, flip: bool = False) -> SymmetryGroup:
        """Return all rotations about `axis`; `flip` adds the half turn that swaps its two ends."""
        discrete = transform(so3_exp(np.pi * _normal_to(axis)))[None] if flip else np.zeros((0, 4, 4))
        return SymmetryGroup(discrete, (ContinuousSymmetry(axis),))

    @property
    def is_trivial(self) -> bool:
        """Return whether only the identity maps the part onto itself."""
        return len(self.discrete) == 0 and not self.continuous

    @cached_property
    def _with_identity(self) -> Float[np.ndarray, "n 4 4"]:
        return np.concatenate([np.eye(4)[None], self.discrete])

    def transforms(self, steps: int = 64) -> Float[np.ndarray, "m 4 4"]:
        """Return the whole group, identity first, with each continuous axis cut into `steps` equal rotations."""
        if not self.continuous:
            return self._with_identity
        angles = 2 * np.pi * np.arange(steps) / steps
        return np.concatenate(
            [(s.rotation(angles)[:, None] @ self._with_identity[None]).reshape(-1, 4, 4) for s in self.continuous]
        )


def _normal_to(axis: tuple[float, float, float]) -> Float[np.ndarray, "3"]:
    """Return the coordinate direction made normal to `axis`, preferring x, then y."""
    a = np.asarray(axis, float)
    for candidate in np.eye(3):
        normal = candidate - a * (a @ candidate)
        if np.linalg.norm(normal) > 0.5:
            return normal / np.linalg.norm(normal)
    raise ConfigError(f"symmetry axis must be a unit vector, got {axis}")
