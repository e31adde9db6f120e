"""Rotations in torch: differentiable, batched over leading dimensions, with gradients that stay finite everywhere.

Same conventions as `simpick.geometry.transforms`: quaternions are wxyz, a 6D rotation is the first two columns.
Not imported by `simpick.geometry`, which loads no torch.
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable


def skew(vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Return the matrix [v]x with [v]x w = v x w."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).unflatten(-1, (3, 3))


def so3_exp(rotation_vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Return the rotation about `rotation_vector` by its norm in radians (Rodrigues)."""
    angle_sq = (rotation_vector**2).sum(-1)[..., None, None]
    small = angle_sq < 1e-3
    # The root of zero has no gradient: where the series is taken, the closed form must not see a zero either.
    angle = torch.where(small, torch.ones_like(angle_sq), angle_sq).sqrt()
    a = torch.where(small, 1 - angle_sq / 6 + angle_sq**2 / 120 - angle_sq**3 / 5040, angle.sin() / angle)
    half_sinc = (angle / 2).sin() / angle
    b = torch.where(small, 0.5 - angle_sq / 24 + angle_sq**2 / 720 - angle_sq**3 / 40320, 2 * half_sinc**2)
    W = skew(rotation_vector)
    return torch.eye(3, dtype=W.dtype, device=W.device) + a * W + b * (W @ W)


def so3_log(R: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3"]:
    """Return the rotation vector in radians, of norm in [0, pi]; differentiable up to, not at, a half turn."""
    q = quaternion_from_matrix(R)
    w, v = q[..., :1], q[..., 1:]
    norm_sq = (v**2).sum(-1, keepdim=True)
    small = norm_sq < 1e-6
    norm = torch.where(small, torch.ones_like(norm_sq), norm_sq).sqrt()
    near_one = torch.where(small, w, torch.ones_like(w))
    scale = torch.where(small, 2 / near_one - 2 * norm_sq / (3 * near_one**3), 2 * torch.atan2(norm, w) / norm)
    return scale * v


def quaternion_from_matrix(R: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 4"]:
    """Return the unit quaternion wxyz with w >= 0 (Shepperd's method: the largest component is never divided by)."""
    xx, yy, zz = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    trace = xx + yy + zz
    wx, wy, wz = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    xy, xz, yz = R[..., 1, 0] + R[..., 0, 1], R[..., 2, 0] + R[..., 0, 2], R[..., 2, 1] + R[..., 1, 2]
    candidates = torch.stack(
        [
            torch.stack([1 + trace, wx, wy, wz], -1),
            torch.stack([wx, 1 + xx - yy - zz, xy, xz], -1),
            torch.stack([wy, xy, 1 - xx + yy - zz, yz], -1),
            torch.stack([wz, xz, yz, 1 - xx - yy + zz], -1),
        ],
        dim=-2,
    )
    best = torch.stack([trace, xx, yy, zz], -1).argmax(-1)
    q = torch.take_along_dim(candidates, best[..., None, None], dim=-2).squeeze(-2)
    q = q / torch.linalg.vector_norm(q, dim=-1, keepdim=True)
    return torch.where(q[..., :1] < 0, -q, q)


def matrix_from_quaternion(q: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3 3"]:
    """Return the rotation matrix of a quaternion wxyz of any non-zero norm."""
    q = q / torch.linalg.vector_norm(q, dim=-1, keepdim=True)
    V = skew(q[..., 1:])
    return torch.eye(3, dtype=q.dtype, device=q.device) + 2 * q[..., :1, None] * V + 2 * (V @ V)


def rotation_to_6d(R: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 6"]:
    """Return the first two columns of R, one after the other (Zhou et al. 2019)."""
    return torch.cat([R[..., :, 0], R[..., :, 1]], dim=-1)


def rotation_from_6d(columns: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 3 3"]:
    """Return the rotation whose first two columns are `columns`, made orthonormal (Gram-Schmidt, Zhou et al. 2019).

    Total, with the same replacements for columns without a direction as `transforms.rotation_from_6d`.
    """
    identity = torch.eye(3, dtype=columns.dtype, device=columns.device)
    x = _normalized_or(columns[..., :3], identity[0])
    y = columns[..., 3:] - (columns[..., 3:] * x).sum(-1, keepdim=True) * x
    axis = identity[x.detach().abs().argmin(-1)]
    y = _normalized_or(y, axis - (axis * x).sum(-1, keepdim=True) * x)
    # Once more, because a nearly parallel second column loses its digits in the subtraction above.
    y = _normalized_or(y - (y * x).sum(-1, keepdim=True) * x, y)
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


def rotation_angle(R: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch"]:
    """Return the angle of a rotation in radians, in [0, pi]; the gradient at the identity is zero, not NaN."""
    return torch.linalg.vector_norm(so3_log(R), dim=-1)


def project_to_so3(M: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Return the rotation nearest to M in the Frobenius norm, determinant fixed to +1; computed in float64.

    With M = U S V^T it is U diag(1, 1, det(U V^T)) V^T. The gradient is that of the projection itself: it divides
    by sums of singular values, so that it is finite where they coincide, as they do at every rotation matrix.
    """
    return _ProjectToSO3.apply(M.double()).to(M.dtype)  # pyright: ignore[reportOptionalMemberAccess]


def kabsch(
    source: Float[Tensor, "*batch n 3"],
    target: Float[Tensor, "*batch n 3"],
    weights: Float[Tensor, "*batch n"] | None = None,
) -> Float[Tensor, "*batch 3 3"]:
    """Return the rotation R that minimises sum w |target - R source|^2: RayPose's decoding of a rotation map."""
    source, target_64 = source.double(), target.double()
    if weights is not None:
        target_64 = target_64 * weights.double()[..., None]
    return project_to_so3(target_64.mT @ source).to(target.dtype)


def random_rotations(
    shape: tuple[int, ...], generator: torch.Generator, dtype: torch.dtype = torch.float32
) -> Float[Tensor, "*batch 3 3"]:
    """Return uniformly distributed rotations on the generator's device (normalised Gaussian quaternions)."""
    q = torch.randn((*shape, 4), generator=generator, device=generator.device, dtype=dtype)
    return matrix_from_quaternion(q)


class _ProjectToSO3(torch.autograd.Function):
    """The projection with its own derivative: torch's for the SVD is infinite where singular values coincide."""

    @staticmethod
    def forward(ctx: Any, M: Tensor) -> Tensor:
        U, S, Vh = torch.linalg.svd(M)
        sign = torch.where(torch.linalg.det(U @ Vh) < 0, -1.0, 1.0).to(M.dtype)
        flip = torch.ones_like(S)
        flip[..., 2] = sign
        R = (U * flip[..., None, :]) @ Vh
        ctx.save_for_backward(R, S * flip, Vh.mT)
        return R

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *grads: Any) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        # M = R P with P = V S V^T symmetric. From dM = dR P + R dP, the skew part W of R^T dR solves, in V's frame,
        # W_ij (s_i + s_j) = (Z - Z^T)_ij with Z = V^T R^T dM V. Transposed, that is the gradient below.
        R, S, V = ctx.saved_tensors
        Y = V.mT @ R.mT @ grads[0] @ V
        pair = S[..., :, None] + S[..., None, :]
        # Two opposite singular values leave the rotation undefined; a large finite gradient beats an infinite one.
        B = (Y - Y.mT) / pair.clamp_min(1e-9 * (1 + S[..., :1, None].abs()))
        return R @ V @ B @ V.mT


def _normalized_or(vector: Float[Tensor, "*batch 3"], fallback: Float[Tensor, "*any"]) -> Float[Tensor, "*batch 3"]:
    """Return unit vectors, from `fallback` where `vector` is too short to have a direction."""
    vector = torch.where((vector**2).sum(-1, keepdim=True) < 1e-18, fallback, vector)
    return vector / torch.linalg.vector_norm(vector, dim=-1, keepdim=True)
