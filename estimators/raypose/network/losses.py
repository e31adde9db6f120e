"""The paper's losses (sec. 3.4), one function per equation, and the losses of matching and flow, which are ours."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.raypose.network.loss_weights import LossWeights
from simpick.estimators.raypose.network.pose_maps import ViewPoses, canonical_rays, decode_centre

Maps = Float[Tensor, "*batch p p channels"]


def ray_reconstruction(predicted: Maps, target: Maps) -> Float[Tensor, ""]:
    """Return 1/p^2 |M_R - M_R*|^2, averaged over the batch (eq. 11)."""
    return (predicted - target).square().sum(dim=-1).mean()


def ray_cosine(predicted: Maps, target: Maps) -> Float[Tensor, ""]:
    """Return 1 - cosine between predicted and true rays, averaged."""
    return (1 - F.cosine_similarity(predicted, target, dim=-1)).mean()


def ray_consistency(predicted: Maps) -> Float[Tensor, ""]:
    """Return the mean squared difference between neighbouring rays' angles and those of the canonical rays (eq. 12)."""
    canonical = canonical_rays(predicted.shape[-2], device=predicted.device).to(predicted.dtype)
    errors = [
        (angles - expected).square().flatten(-2)
        for angles, expected in zip(_neighbour_angles(predicted), _neighbour_angles(canonical), strict=True)
    ]
    return torch.cat(errors, dim=-1).mean()


def translation_reconstruction(predicted: Maps, target: Maps) -> Float[Tensor, ""]:
    """Return 1/p^2 |M_T - M_T*|^2, averaged over the batch (eq. 14)."""
    return (predicted - target).square().sum(dim=-1).mean()


def translation_xyz(predicted: Maps, query: ViewPoses, reference: ViewPoses, padding: float) -> Float[Tensor, ""]:
    """Return the L1 error of the decoded x, y and z (eq. 15), x and y in half extents of the query, z in its depth.

    Relative, so that large and distant parts do not count more; `query` is the truth.
    """
    ratio = (
        predicted[..., 2].mean(dim=(-2, -1)) + (reference.half_extent_at_depth_m / query.half_extent_at_depth_m).log()
    ).exp()
    lateral = decode_centre(predicted[..., :2], padding) * ratio[..., None] - query.centre
    return (lateral.abs().sum(dim=-1) + (ratio - 1).abs()).mean()


def matching(
    log_probabilities: Float[Tensor, "batch query_cells template_cells"],
    query_points: Float[Tensor, "batch query_cells 3"],
    query_valid: Bool[Tensor, "batch query_cells"],
    template_points: Float[Tensor, "batch template_cells 3"],
    template_valid: Bool[Tensor, "batch template_cells"],
    *,
    sigma: float = 0.035,
) -> Float[Tensor, ""]:
    """Return the cross-entropy between the matches of query cells and the template cells near the true point.

    Positions are in diameters, in the part's frame. Query cells whose point no template cell shows are left out.
    """
    nearness = torch.cdist(query_points, template_points).square() / (-2 * sigma**2)
    target = nearness.exp() * template_valid[:, None]
    seen = query_valid & (target.amax(dim=-1) > 0.3)
    target = target / target.sum(dim=-1, keepdim=True).clamp_min(1e-9)
    entropy = -(target * log_probabilities).sum(dim=-1)  # (batch, query cells)
    return (entropy * seen).sum() / seen.sum().clamp_min(1)


def matched_points(
    points: Float[Tensor, "batch query_cells 3"],
    query_points: Float[Tensor, "batch query_cells 3"],
    query_valid: Bool[Tensor, "batch query_cells"],
) -> Float[Tensor, ""]:
    """Return the mean distance between matched and true points, in diameters; large distances saturate."""
    error = (points - query_points).norm(dim=-1)
    # Some cells show what no template shows.
    error = 0.15 * torch.tanh(error / 0.15)
    return (error * query_valid).sum() / query_valid.sum().clamp_min(1)


def visibility(predicted: Float[Tensor, "batch cells"], coverage: Float[Tensor, "batch cells"]) -> Float[Tensor, ""]:
    """Return the cross-entropy of the estimated and the true visible share of each cell."""
    p = predicted.float().clamp(1e-5, 1 - 1e-5)
    return -(coverage * p.log() + (1 - coverage) * (1 - p).log()).mean()


def view_embedding(
    logits: Float[Tensor, "batch views"], angles_rad: Float[Tensor, "batch views"], *, sigma_rad: float = 0.2
) -> Float[Tensor, ""]:
    """Return the cross-entropy between the views that embeddings choose and those rotated little against the query.

    Other parts' views are at infinite angles. Queries that no view is near to are left out.
    """
    target = (angles_rad.square() / (-2 * sigma_rad**2)).exp()
    seen = target.amax(dim=-1) > 0.1
    target = target / target.sum(dim=-1, keepdim=True).clamp_min(1e-9)
    entropy = -(target * logits.log_softmax(dim=-1)).sum(dim=-1)
    return (entropy * seen).sum() / seen.sum().clamp_min(1)


def flow_matching(
    log_probabilities: Float[Tensor, "batch cells offsets"],
    offsets: Float[Tensor, "offsets 2"],
    wanted: Float[Tensor, "batch cells 2"],
    valid: Bool[Tensor, "batch cells"],
    unit: float,
) -> Float[Tensor, ""]:
    """Return the cross-entropy between the measured and the true offsets of template cells.

    `unit` is a cell's width; the target is a normal distribution of 0.6 cells around the true offset.
    """
    distance = (wanted[..., None, :] - offsets).square().sum(dim=-1)
    target = (distance / (-2 * (0.6 * unit) ** 2)).softmax(dim=-1)
    entropy = -(target * log_probabilities).sum(dim=-1)
    return (entropy * valid).sum() / valid.sum().clamp_min(1)


def flow_offset(
    offset: Float[Tensor, "batch cells 2"],
    wanted: Float[Tensor, "batch cells 2"],
    valid: Bool[Tensor, "batch cells"],
    unit: float,
) -> Float[Tensor, ""]:
    """Return the mean distance between measured and true offsets, in cells; large distances are clamped."""
    error = ((offset - wanted) / unit).norm(dim=-1).clamp(max=4.0)
    return (error * valid).sum() / valid.sum().clamp_min(1)


def flow_pose(
    R: Float[Tensor, "batch 3 3"],
    centre: Float[Tensor, "batch 2"],
    log_scale: Float[Tensor, "batch"],
    R_true: Float[Tensor, "batch 3 3"],
    centre_true: Float[Tensor, "batch 2"],
    log_scale_true: Float[Tensor, "batch"],
) -> Float[Tensor, ""]:
    """Return the L1-like error of a pose: chordal distance, centre in half sides, log scale; large errors saturate."""
    turn = (R - R_true).square().sum(dim=(-2, -1)).clamp_min(1e-12).sqrt()
    shift = (centre - centre_true).abs().sum(dim=-1).clamp(max=0.3)
    size = (log_scale - log_scale_true).abs().clamp(max=0.3)
    return (0.3 * torch.tanh(turn / 0.3) + 2 * shift + 2 * size).mean()


def pose_map_losses(
    predicted: Float[Tensor, "batch views p p 6"],
    target: Float[Tensor, "batch views p p 6"],
    query: ViewPoses,
    reference: ViewPoses,
    padding: float,
) -> dict[str, Float[Tensor, ""]]:
    """Return the paper's terms, by the names of `LossWeights`."""
    return {
        "ray_reconstruction": ray_reconstruction(predicted[..., :3], target[..., :3]),
        "ray_cosine": ray_cosine(predicted[..., :3], target[..., :3]),
        "ray_consistency": ray_consistency(predicted[..., :3]),
        "translation_reconstruction": translation_reconstruction(predicted[..., 3:], target[..., 3:]),
        "translation_xyz": translation_xyz(predicted[..., 3:], query, reference, padding),
    }


def weighted_sum(terms: dict[str, Float[Tensor, ""]], weights: LossWeights) -> Float[Tensor, ""]:
    """Return the overall loss (eq. 17)."""
    return torch.stack([getattr(weights, name) * value for name, value in terms.items()]).sum()


def _neighbour_angles(rays: Maps) -> tuple[Tensor, Tensor]:
    """Return the angles between each ray and the next to the right, and the next below."""
    unit = F.normalize(rays, dim=-1)

    def angle(a: Tensor, b: Tensor) -> Tensor:
        # The arc cosine's gradient is infinite at 0 and pi.
        return torch.acos((a * b).sum(dim=-1).clamp(-1 + 1e-6, 1 - 1e-6))

    return angle(unit[..., :, :-1, :], unit[..., :, 1:, :]), angle(unit[..., :-1, :, :], unit[..., 1:, :, :])
