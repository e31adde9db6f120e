"""Residuals between rendering and image, their analytic Jacobian, and the normal equations of Gauss-Newton.

The six parameters are a rotation vector (rad, in the crop's frame, about the part's origin), a shift of the origin's
projection (in units of the focal length) and the logarithm of the origin's depth. A rendered map M moves with the
surface that it shows: ``dM = -grad M . du``, where du is the motion of the surface point's projection.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from simpick.estimators.refiner.blurring import blur, central_differences, eroded
from simpick.estimators.refiner.config import RefinerConfig
from simpick.estimators.refiner.rendered_maps import RenderedMaps, pixel_offsets
from simpick.geometry import so3_exp
from simpick.tensor_record import TensorRecord

_LIGHT_ROUNDS = 2
"""Rounds of reweighting in the fit of the light."""
_LIGHT_RIDGE = 3e-3
"""Strength of the prior for ambient light only, relative to the pixels' weight."""


@dataclass(frozen=True, eq=False)
class Target(TensorRecord):
    """Maps of the image to align with, one row per crop; they stay the same throughout a level."""

    brightness: Float[Tensor, "n size size"]
    mask: Float[Tensor, "n size size"]
    trust: Float[Tensor, "n size size"]
    core: Float[Tensor, "n size size"]
    """1 where the mask covers a pixel and its neighbours, else 0."""
    blurred_core: Float[Tensor, "n coarse coarse"]
    focal_px: Float[Tensor, "n"]
    blur_px: float
    stride: int
    """Residuals are taken at the centres of blocks this many pixels wide."""

    @staticmethod
    def of(
        brightness: Float[Tensor, "n size size"],
        mask: Float[Tensor, "n size size"],
        trust: Float[Tensor, "n size size"],
        focal_px: Float[Tensor, "n"],
        blur_px: float,
        stride: int = 1,
    ) -> Target:
        """Return the target of these maps of the image."""
        core = eroded((mask > 0.5).float())
        return Target(brightness, mask, trust, core, blur(core, blur_px, stride), focal_px, blur_px, stride)


@dataclass(frozen=True, eq=False)
class Alignment(TensorRecord):
    """How well n hypotheses fit, and the normal equations of their next step."""

    cost: Float[Tensor, "n"]
    """Robust misfit, which Gauss-Newton minimises."""
    misfit: Float[Tensor, "n"]
    """Mean robust misfit over mask and silhouette in [0, 1]; uncovered parts of the mask count as wrong. It ranks the
    hypotheses of one detection."""
    hessian: Float[Tensor, "n 6 6"]
    gradient: Float[Tensor, "n 6"]


def align(target: Target, rendered: RenderedMaps, centres: Float[Tensor, "n 2"], config: RefinerConfig) -> Alignment:
    """Compare; `centres` are projections of the part's origin, in units of the focal length from the middle."""
    trust, stride = target.trust, target.stride
    covered = rendered.silhouette
    f = target.focal_px[:, None, None]
    edge_x, edge_y = central_differences(covered)
    inner = eroded(covered) * target.core
    sharp = torch.stack(
        [
            rendered.nearness,
            covered,
            trust * (covered - target.mask),
            trust * edge_x,
            trust * edge_y,
            inner,
            inner * target.brightness,
            inner * (rendered.albedo - 1),
            *(inner * rendered.albedo * rendered.normals[:, k] for k in range(3)),
        ]
    )
    blurred = blur(sharp, target.blur_px, stride)
    near, blurred_silhouette, missed, edge_x, edge_y, share, seen, excess = blurred[:8]
    shown = blurred[8:].transpose(0, 1)  # (n, 3, coarse, coarse)

    # Silhouettes: blurred difference where it can be trusted. Beyond the silhouette, depth is that of the nearest edge.
    extended = near / blurred_silhouette.clamp_min(1e-4)
    flow_x, flow_y = projection_jacobian(extended, centres, target.focal_px, stride)
    difference = missed / config.silhouette_scale
    to_flow = f / config.silhouette_scale
    J_silhouette = -((edge_x * to_flow)[:, None] * flow_x + (edge_y * to_flow)[:, None] * flow_y)

    # Brightness: the albedo times a linear function of the surface normal, fitted to each hypothesis.
    light = fit_light(share + excess, shown, seen, config.shading_scale)
    # What varies: ambient light on a surface of one colour is the same everywhere.
    lit = torch.einsum("nk,nkij->nij", light[:, 1:], shown) + light[:, 0, None, None] * excess
    shading = (light[:, 0, None, None] * share + lit - seen) / config.shading_scale
    shade_x, shade_y = central_differences(lit / share.clamp_min(1e-3))
    turned = torch.linalg.cross(shown, light[:, 1:, None, None].expand_as(shown), dim=1)
    to_flow = share * f / stride
    J_shading = -((shade_x * to_flow)[:, None] * flow_x + (shade_y * to_flow)[:, None] * flow_y)
    J_shading[:, :3] += turned
    J_shading = J_shading / config.shading_scale

    weight = config.shading_weight
    H_s, g_s, cost_s, _ = _normal_equations(difference, J_silhouette)
    H_b, g_b, cost_b, robust_b = _normal_equations(shading, J_shading)
    # Pixels of the mask that the rendering leaves uncovered, or covers with its edge only, explain no brightness.
    mask_blocks = target.mask.sum(dim=(1, 2)).clamp_min(1.0) / stride**2
    bare = (target.blurred_core - share).clamp_min(0).sum(dim=(1, 2))
    shading_misfit = ((robust_b * share).sum(dim=(1, 2)) + bare) / mask_blocks
    silhouette_misfit = cost_s / mask_blocks
    misfit = silhouette_misfit + weight * shading_misfit
    return Alignment(cost_s + weight * cost_b, misfit, H_s + weight * H_b, g_s + weight * g_b)


def projection_jacobian(
    nearness: Float[Tensor, "n size size"],
    centres: Float[Tensor, "n 2"],
    focal_px: Float[Tensor, "n"],
    stride: int = 1,
) -> tuple[Float[Tensor, "n 6 size size"], Float[Tensor, "n 6 size size"]]:
    """Return the motion of the surface point at each pixel per parameter, along x and y, over the focal length.

    With Q the nearness (origin depth over surface depth), x, y the pixel and x0, y0 the origin's projection, all over
    the focal length: every column is linear in Q. A pixel of the map is `stride` pixels wide.
    """
    size = nearness.shape[-1]
    px, py = (stride * offsets for offsets in pixel_offsets(size))
    f = focal_px[:, None, None]
    Q = nearness
    x, y = (px / f).expand_as(Q), (py / f).expand_as(Q)
    x0, y0 = centres[:, 0, None, None], centres[:, 1, None, None]
    a, b, c = y - y0 * Q, x - x0 * Q, 1 - Q
    zero = torch.zeros_like(Q)
    flow_x = torch.stack([-x * a, c + x * b, -a, Q, zero, (x0 - x) * Q], dim=1)
    flow_y = torch.stack([-c - y * a, y * b, b, zero, Q, (y0 - y) * Q], dim=1)
    return flow_x, flow_y


def moved(Ts_crop_part: Float[np.ndarray, "n 4 4"], steps: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 4 4"]:
    """Return the poses after these steps of the six parameters."""
    out = Ts_crop_part.copy()
    out[:, :3, :3] = so3_exp(steps[:, :3]) @ Ts_crop_part[:, :3, :3]
    depth = Ts_crop_part[:, 2, 3]
    centres = Ts_crop_part[:, :2, 3] / depth[:, None] + steps[:, 3:5]
    out[:, 2, 3] = depth * np.exp(steps[:, 5])
    out[:, :2, 3] = centres * out[:, 2, 3, None]
    return out


def fit_light(
    share: Float[Tensor, "n size size"],
    shown: Float[Tensor, "n 3 size size"],
    seen: Float[Tensor, "n size size"],
    scale: float,
) -> Float[Tensor, "n 4"]:
    """Return the ambient and directional light that best explain the image, by reweighted least squares."""
    A = torch.cat([share[:, None], shown], dim=1).flatten(2)  # (n, 4, pixels)
    y = seen.flatten(1)
    weights = torch.ones_like(y)
    light = y.new_zeros(len(y), 4)
    pixels = share.square().sum(dim=(1, 2)).clamp_min(1e-3)
    ambient = torch.tensor([1.0, 0.0, 0.0, 0.0])
    ridge = _LIGHT_RIDGE * pixels[:, None, None] * torch.eye(4)
    for _ in range(_LIGHT_ROUNDS):
        weighted = A * weights[:, None]
        M = weighted @ A.transpose(1, 2) + ridge
        v = (weighted @ y[..., None])[..., 0] + ridge @ ambient
        light = torch.linalg.solve(M, v)
        residual = (torch.einsum("nk,nkp->np", light, A) - y) / scale
        weights = 1 / (1 + residual.square()).square()
    return light


def _normal_equations(
    residual: Float[Tensor, "n size size"], J: Float[Tensor, "n 6 size size"]
) -> tuple[Float[Tensor, "n 6 6"], Float[Tensor, "n 6"], Float[Tensor, "n"], Float[Tensor, "n size size"]]:
    """Return Hessian, gradient and cost under the Geman-McClure kernel r^2 / (1 + r^2), and that kernel's map."""
    square = residual.square()
    robust = square / (1 + square)
    weights = 1 / (1 + square).square()
    flat = J.flatten(2)
    weighted = flat * weights.flatten(1)[:, None]
    gradient = (weighted @ residual.flatten(1)[..., None])[..., 0]
    return weighted @ flat.transpose(1, 2), gradient, robust.sum(dim=(1, 2)), robust
