"""Poses from matched points: robust Gauss-Newton on where each query cell's place of the part should appear.

Not in the paper. It turns matches into a first answer for every template, which the diffusion decoder then corrects:
geometry that is known need not be learned.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.geometry.torch_rotations import so3_exp

ITERATIONS = 8
_KERNEL = 0.12
"""Half sides of the crop at which a residual counts half (Geman-McClure)."""
_DAMPING = 1e-2
"""Of the normal equations, relative to the sum of weights or information; a flat part leaves some directions open."""
_LARGEST_STEP = 0.5
"""Radians, half sides, or logarithm of scale: how far one iteration may go."""


@dataclass(frozen=True, eq=False)
class SolvedPoses:
    """One pose for each start."""

    R: Float[Tensor, "batch views 3 3"]
    centre: Float[Tensor, "batch views 2"]
    """Projection of the part's origin, in half crop sides."""
    log_scale: Float[Tensor, "batch views"]
    """Logarithm of the part's diameter over the view's reach."""
    residuals: Float[Tensor, "batch views cells 2"]
    """Where each cell's pixels are, less where its matched point appears, in half crop sides."""


def solve_poses(
    points: Float[Tensor, "batch cells 3"],
    places: Float[Tensor, "batch cells 2"],
    weights: Float[Tensor, "batch cells"],
    half_tangent: Float[Tensor, "batch"],
    start: SolvedPoses,
    iterations: int = ITERATIONS,
    *,
    whitening: Float[Tensor, "batch cells 2 2"] | None = None,
    damping: float = _DAMPING,
) -> SolvedPoses:
    """Return the poses that project `points` (part frame, diameters) closest to `places`, from each start.

    `whitening` is a square root of each residual's information, if that is not the same in all directions. Every
    iteration but the last is without gradient: the last, from where the others ended, carries the gradient of the
    solution with respect to points, places and weights.
    """
    # In single precision, whatever the network around runs in.
    with torch.autocast(points.device.type, enabled=False):
        points, weights = points.float(), weights.float()
        pose = start
        with torch.no_grad():
            for _ in range(iterations - 1):
                pose = _step(points, places, weights, half_tangent, pose, whitening, damping)
        pose = _step(points, places, weights, half_tangent, pose, whitening, damping)
        residuals = residuals_of(points, places, half_tangent, pose)
        return SolvedPoses(pose.R, pose.centre, pose.log_scale, residuals)


def support(
    points: Float[Tensor, "batch cells 3"],
    places: Float[Tensor, "batch cells 2"],
    weights: Float[Tensor, "batch cells"],
    coverage: Float[Tensor, "batch cells"],
    half_tangent: Float[Tensor, "batch"],
    pose: SolvedPoses,
) -> Float[Tensor, "batch views"]:
    """Return how much of the part's visible area is matched where the pose says, in [0, 1]."""
    r = residuals_of(points, places, half_tangent, pose)
    agreement = (1 + r.square().sum(dim=-1) / _KERNEL**2).square().reciprocal()
    return (weights[:, None] * agreement).sum(dim=-1) / coverage.sum(dim=-1, keepdim=True).clamp_min(1e-6)


def _step(
    points: Float[Tensor, "batch cells 3"],
    places: Float[Tensor, "batch cells 2"],
    weights: Float[Tensor, "batch cells"],
    half_tangent: Float[Tensor, "batch"],
    pose: SolvedPoses,
    whitening: Float[Tensor, "batch cells 2 2"] | None,
    damping: float,
) -> SolvedPoses:
    projected, seen = project(points, half_tangent, pose)  # (batch, views, cells, 2), (batch, views, cells, 3)
    r = places[:, None] - projected
    robust = (1 + r.detach().square().sum(dim=-1) / _KERNEL**2).square().reciprocal()
    w = weights[:, None] * robust  # (batch, views, cells)
    x, y, z = seen.unbind(dim=-1)
    zero, one = torch.zeros_like(x), torch.ones_like(x)
    # Rows of d(projection) / d(rotation vector, centre, log scale), without perspective, which is small.
    J = torch.stack(
        [torch.stack([zero, z, -y, one, zero, x], dim=-1), torch.stack([-z, zero, x, zero, one, y], dim=-1)], dim=-2
    )  # (batch, views, cells, 2, 6)
    total = weights
    if whitening is not None:
        r, J = (whitening[:, None] @ r[..., None]).squeeze(-1), whitening[:, None] @ J
        total = weights * whitening.square().sum(dim=(-2, -1)) / 2
    Jw = (J * w[..., None, None]).flatten(2, 3).mT  # (batch, views, 6, 2 cells)
    A = Jw @ J.flatten(2, 3)
    g = (Jw @ r.flatten(2)[..., None]).squeeze(-1)
    damped = A.new_tensor([1.0, 1.0, 1.0, 0.1, 0.1, 1.0])
    A = A + (damping * total.sum(dim=-1)[:, None, None, None] + 1e-6) * torch.diag(damped)
    step = torch.linalg.solve(A, g).clamp(-_LARGEST_STEP, _LARGEST_STEP)
    return SolvedPoses(
        so3_exp(step[..., :3]) @ pose.R,
        (pose.centre + step[..., 3:5]).clamp(-2.0, 2.0),
        (pose.log_scale + step[..., 5]).clamp(-2.5, 2.5),
        r,
    )


def residuals_of(
    points: Float[Tensor, "batch cells 3"],
    places: Float[Tensor, "batch cells 2"],
    half_tangent: Float[Tensor, "batch"],
    pose: SolvedPoses,
) -> Float[Tensor, "batch views cells 2"]:
    """Return how far `places` are from where the poses project `points`, in half crop sides."""
    return places[:, None] - project(points, half_tangent, pose)[0]


def project(
    points: Float[Tensor, "batch cells 3"], half_tangent: Float[Tensor, "batch"], pose: SolvedPoses
) -> tuple[Float[Tensor, "batch views cells 2"], Float[Tensor, "batch views cells 3"]]:
    """Return where poses project points, and the points turned and scaled into half sides about the part's origin."""
    # In single precision, whatever the network around runs in: a sixtieth of a cell counts.
    with torch.autocast(points.device.type, enabled=False):
        turned = torch.einsum("bkij,bnj->bkni", pose.R.float(), points.float())
        seen = turned * pose.log_scale.float().exp()[..., None, None]
        perspective = 1 + half_tangent[:, None, None] * seen[..., 2]
        return (seen[..., :2] + pose.centre.float()[:, :, None]) / perspective[..., None], seen
