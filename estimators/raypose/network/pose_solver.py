"""Poses from matched points: robust Gauss-Newton on the projections of points of the part.

Not in the paper. It turns matches into a first pose for each template, which the diffusion decoder then corrects:
geometry that is known need not be learned.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.geometry.torch_rotations import so3_exp
from simpick.tensor_record import TensorRecord

ITERATIONS = 8
_KERNEL = 0.12
"""Residual in half crop sides at which the Geman-McClure weight is 1/4."""
_DAMPING = 1e-2
"""Of the normal equations, relative to the sum of weights or information; a flat part leaves some directions open."""
_LARGEST_STEP = 0.5
"""Largest step per iteration, in radians, half sides, or logarithm of scale."""


@dataclass(frozen=True, eq=False)
class SolvedPoses(TensorRecord):
    """Poses as the solver parameterizes them; leading dimensions are free, mostly (batch, views)."""

    R: Float[Tensor, "*batch 3 3"]
    centre: Float[Tensor, "*batch 2"]
    """Projection of the part's origin, in half crop sides."""
    log_scale: Float[Tensor, "*batch"]
    """Logarithm of the part's diameter over the crop's half extent at the part's depth."""

    @staticmethod
    def of(views: ViewPoses, diameter_m: Float[Tensor, "*batch"]) -> SolvedPoses:
        """Return the views' poses of parts of this diameter."""
        return SolvedPoses(views.R, views.centre, (diameter_m / views.half_extent_at_depth_m).log())

    def views(self, diameter_m: Float[Tensor, "*batch"]) -> ViewPoses:
        """Return the poses as views: the inverse of `of`."""
        return ViewPoses(self.R, self.centre, diameter_m / self.log_scale.exp())


def solve_poses(
    points: Float[Tensor, "batch cells 3"],
    observed: Float[Tensor, "batch cells 2"],
    weights: Float[Tensor, "batch cells"],
    half_tangent: Float[Tensor, "batch"],
    start: SolvedPoses,
    iterations: int = ITERATIONS,
    *,
    whitening: Float[Tensor, "batch cells 2 2"] | None = None,
    damping: float = _DAMPING,
) -> SolvedPoses:
    """Return the poses that project `points` (part frame, diameters) closest to where they are `observed`.

    `whitening` is a square root of each residual's information matrix, if that is not isotropic. Only the last
    iteration carries a gradient: that of the solution with respect to points, observations and weights.
    """
    # In single precision, also where the network runs in another.
    with torch.autocast(points.device.type, enabled=False):
        points, weights = points.float(), weights.float()
        pose = start
        with torch.no_grad():
            for _ in range(iterations - 1):
                pose = _step(points, observed, weights, half_tangent, pose, whitening, damping)
        return _step(points, observed, weights, half_tangent, pose, whitening, damping)


def support(
    points: Float[Tensor, "batch cells 3"],
    observed: Float[Tensor, "batch cells 2"],
    weights: Float[Tensor, "batch cells"],
    coverage: Float[Tensor, "batch cells"],
    half_tangent: Float[Tensor, "batch"],
    pose: SolvedPoses,
) -> Float[Tensor, "batch views"]:
    """Return the share of the part's visible area that is matched where the pose projects it, in [0, 1]."""
    robust = _robust_weight(residuals(points, observed, half_tangent, pose))
    return (weights[:, None] * robust).sum(dim=-1) / coverage.sum(dim=-1, keepdim=True).clamp_min(1e-6)


def _step(
    points: Float[Tensor, "batch cells 3"],
    observed: Float[Tensor, "batch cells 2"],
    weights: Float[Tensor, "batch cells"],
    half_tangent: Float[Tensor, "batch"],
    pose: SolvedPoses,
    whitening: Float[Tensor, "batch cells 2 2"] | None,
    damping: float,
) -> SolvedPoses:
    projected, scaled = project(points, half_tangent, pose)  # (batch, views, cells, 2), (batch, views, cells, 3)
    r = observed[:, None] - projected
    w = weights[:, None] * _robust_weight(r.detach())  # (batch, views, cells)
    x, y, z = scaled.unbind(dim=-1)
    zero, one = torch.zeros_like(x), torch.ones_like(x)
    # d(projection) / d(rotation vector, centre, log scale), without perspective, which is small. Cells come last, so
    # that all products run along memory: (batch, views, 6, cells) for each axis of the image.
    J_x, J_y = torch.stack([zero, z, -y, one, zero, x], dim=2), torch.stack([-z, zero, x, zero, one, y], dim=2)
    r_x, r_y = r.unbind(dim=-1)
    total = weights
    if whitening is not None:
        (a, b), (c, d) = (row.unbind(dim=-1) for row in whitening[:, None].unbind(dim=-2))  # (batch, 1, cells)
        r_x, r_y = a * r_x + b * r_y, c * r_x + d * r_y
        a, b, c, d = (value[:, :, None] for value in (a, b, c, d))
        J_x, J_y = a * J_x + b * J_y, c * J_x + d * J_y
        total = weights * whitening.square().sum(dim=(-2, -1)) / 2
    J, r = torch.cat([J_x, J_y], dim=-1), torch.cat([r_x, r_y], dim=-1)  # (batch, views, 6, 2 cells)
    Jw = J * torch.cat([w, w], dim=-1)[:, :, None]
    A = Jw @ J.mT
    g = (Jw @ r[..., None]).squeeze(-1)
    damped = A.new_tensor([1.0, 1.0, 1.0, 0.1, 0.1, 1.0])
    A = A + (damping * total.sum(dim=-1)[:, None, None, None] + 1e-6) * torch.diag(damped)
    step = torch.linalg.solve(A, g).clamp(-_LARGEST_STEP, _LARGEST_STEP)
    return SolvedPoses(
        so3_exp(step[..., :3]) @ pose.R,
        (pose.centre + step[..., 3:5]).clamp(-2.0, 2.0),
        (pose.log_scale + step[..., 5]).clamp(-2.5, 2.5),
    )


def _robust_weight(residuals: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch"]:
    """Return the Geman-McClure weight 1 / (1 + |r|^2 / k^2)^2."""
    return (1 + residuals.square().sum(dim=-1) / _KERNEL**2).square().reciprocal()


def residuals(
    points: Float[Tensor, "batch cells 3"],
    observed: Float[Tensor, "batch cells 2"],
    half_tangent: Float[Tensor, "batch"],
    pose: SolvedPoses,
) -> Float[Tensor, "batch views cells 2"]:
    """Return how far points are `observed` from their projections, in half crop sides."""
    return observed[:, None] - project(points, half_tangent, pose)[0]


def project(
    points: Float[Tensor, "batch cells 3"], half_tangent: Float[Tensor, "batch"], pose: SolvedPoses
) -> tuple[Float[Tensor, "batch views cells 2"], Float[Tensor, "batch views cells 3"]]:
    """Return the projections of points, and the points rotated and scaled into half crop sides about the origin."""
    # In single precision, also where the network runs in another: a sixtieth of a cell counts.
    with torch.autocast(points.device.type, enabled=False):
        rotated = torch.einsum("bkij,bnj->bkni", pose.R.float(), points.float())
        scaled = rotated * pose.log_scale.float().exp()[..., None, None]
        perspective = 1 + half_tangent[:, None, None] * scaled[..., 2]
        return (scaled[..., :2] + pose.centre.float()[:, :, None]) / perspective[..., None], scaled
