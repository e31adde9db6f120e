"""`RayPose`: the whole network. Templates are encoded once, a query once, and only the decoder runs at every step."""

from __future__ import annotations

import dataclasses
import math

import torch
from jaxtyping import Float
from torch import Tensor, nn

from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.consensus import combine_views
from simpick.estimators.raypose.network.decoder import Decoder
from simpick.estimators.raypose.network.flow import FlowCells, TemplateFlow
from simpick.estimators.raypose.network.image_encoder import FeatureMaps, SimpickEncoder, make_image_encoder
from simpick.estimators.raypose.network.layers import SelfAttentionBlock, mlp
from simpick.estimators.raypose.network.matching import FEATURES, Matcher, Matches
from simpick.estimators.raypose.network.pose_maps import CHANNELS, ViewPoses, cell_centres, encode_pose_maps
from simpick.estimators.raypose.network.pose_solver import ITERATIONS, SolvedPoses, residuals_of, solve_poses, support
from simpick.estimators.raypose.network.tokens import (
    Conditioning,
    InitialPoses,
    QueryInputs,
    QueryTokens,
    TemplateInputs,
    TemplateTokens,
    map_tensors,
)
from simpick.estimators.raypose.network.view_encoder import ViewEncoder

_SEARCH_ITERATIONS = 4
"""Enough to tell a turn that fits from one that does not."""


class RayPose(nn.Module):
    """Query encoder, template encoder with multiview fuser, and diffusion transformer decoder (paper, fig. 2)."""

    def __init__(self, config: RayPoseConfig) -> None:
        super().__init__()
        self.config = config
        cells, width = config.map_cells, config.width
        self.stride = config.local_cells // cells
        patch = self.stride**2
        self.image_encoder = make_image_encoder(config)
        self.view_encoder = ViewEncoder(cells, width, config.fourier_bands, config.padding)
        self.embed_image = nn.Linear(patch * config.local_width, width)
        self.embed_geometry = nn.Linear(patch * 4, width)
        self.patch_position = nn.Parameter(0.02 * torch.randn(cells * cells, width))
        self.view_position = nn.Parameter(0.02 * torch.randn(config.templates, width))
        self.fuser = nn.Sequential(*(SelfAttentionBlock(width, config.heads) for _ in range(config.fuser_blocks)))
        self.matcher = Matcher(config.local_width, config.match_width)
        narrow = self.image_encoder.narrow_width if isinstance(self.image_encoder, SimpickEncoder) else 0
        self.flow = TemplateFlow(config, narrow) if config.flow else None
        self.embed_matches = nn.Sequential(nn.Linear(patch * FEATURES, width), mlp(width, 2))
        self.decoder = Decoder(config)

    def encode_query(self, inputs: QueryInputs) -> QueryTokens:
        """Return a query's tokens and descriptors: image and box, since its pose is what is asked for."""
        features = self.image_encoder(inputs.rgb, inputs.masks)
        tokens = self._image_tokens(features.cells) + self.view_encoder.encode_box(inputs.half_tangent)
        coverage, places = self._coverage_and_places(inputs.masks)
        # Each flow cell is a whole number of pixels wide.
        side = self.config.crop_px // self.config.flow_cells
        flow_coverage = nn.functional.avg_pool2d(inputs.masks, side).flatten(1)
        return QueryTokens(
            tokens,
            self.matcher.describe(features.cells),
            coverage,
            places,
            inputs.half_tangent,
            self._flow_descriptors(features),
            flow_coverage if self.flow else flow_coverage[:, :0],
        )

    def encode_templates(self, inputs: TemplateInputs) -> TemplateTokens:
        """Return what templates' images say: tokens and descriptors, before poses are told."""
        batch, views = inputs.coverage.shape[:2]
        features = self.image_encoder(inputs.rgb.flatten(0, 1), inputs.masks.flatten(0, 1))
        tokens = self._image_tokens(features.cells) + self.view_encoder.encode_box(inputs.half_tangent.flatten())
        points, coverage = inputs.points, inputs.coverage
        if self.flow:
            points, coverage = halved_geometry(points, coverage)
        finest = slice(None) if self.flow else slice(0)
        flow = FlowCells(
            self._flow_descriptors(features).unflatten(0, (batch, views)),
            inputs.points[:, :, finest],
            inputs.coverage[:, :, finest],
        )
        return TemplateTokens(
            tokens.unflatten(0, (batch, views)),
            self.matcher.describe(features.cells).unflatten(0, (batch, views)),
            points,
            coverage,
            inputs.poses,
            inputs.diameter_m,
            flow,
        )

    def fuse(self, templates: TemplateTokens) -> TemplateTokens:
        """Return the templates with their poses told and after all views have seen one another (E_V and E_F).

        With their keys and values for the decoder, which depend on no query.
        """
        views, poses = templates.tokens.shape[1], templates.poses
        tokens = templates.tokens + self.view_position[:views, None]
        if self.config.template_pose:
            flat = ViewPoses(poses.R.flatten(0, 1), poses.centre.flatten(0, 1), poses.half_extent_at_depth_m.flatten())
            posed = self.view_encoder.encode_pose(flat, templates.diameter_m.repeat_interleave(views))
            points = _in_view(templates.points, poses, templates.diameter_m)
            geometry = self._patches(torch.cat([points, templates.coverage[..., None]], dim=-1))
            tokens = tokens + posed.unflatten(0, (-1, views)) + self.embed_geometry(geometry)
        # Without multiview, every template is a group of its own.
        first = 1 if self.config.multiview else 0
        fused = self.fuser(tokens.flatten(first, first + 1))  # (groups, tokens, width)
        kv = self.decoder.keys_values(fused)
        return dataclasses.replace(templates, tokens=fused.reshape(tokens.shape), kv=kv)

    def condition(self, query: QueryTokens, fused: TemplateTokens) -> Conditioning:
        """Return what the decoder needs; `fused` must have one set of templates for each query."""
        views = fused.tokens.shape[1]
        reference = self.reference(fused)
        base = query.tokens[:, None] + fused.tokens  # (batch, views, tokens, width)
        first = self.decoder.neutral.expand(*base.shape[:-1], CHANNELS)
        matched = None
        if self.config.matching and self.config.template_pose:
            matched = self.initial_poses(query, fused)
            base = base + self.embed_matches(self._patches(self._match_features(query, fused, matched)))
            first = self.maps_of(matched.poses, fused)
        own = query.tokens
        if not self.config.multiview:
            base, first = base.flatten(0, 1)[:, None], first.flatten(0, 1)[:, None]
            own = own.repeat_interleave(views, 0)
        kv = [
            (torch.cat([k, template_k], dim=2), torch.cat([v, template_v], dim=2))
            for (k, v), (template_k, template_v) in zip(self.decoder.keys_values(own), fused.kv, strict=True)
        ]
        return Conditioning(base, kv, reference, first, matched)

    def denoise(
        self, maps: Float[Tensor, "batch views p p 6"], log_snr: Float[Tensor, "batch"], conditioning: Conditioning
    ) -> Float[Tensor, "batch views p p 6"]:
        """Return the clean maps that noisy ones come from."""
        shape = maps.shape
        noisy = maps.flatten(2, 3)
        if not self.config.multiview:
            noisy, log_snr = noisy.flatten(0, 1)[:, None], log_snr.repeat_interleave(shape[1])
        return self.decoder(noisy, log_snr, conditioning.base, conditioning.first, conditioning.kv).reshape(shape)

    def initial_poses(self, query: QueryTokens, templates: TemplateTokens, *, flow: bool = True) -> InitialPoses:
        """Return matches, the poses solved from them, and what flow makes of these; templates need not be fused.

        Without multiview, every template is a query's only one: as many groups as templates, of one view each.
        """
        views, multiview = templates.tokens.shape[1], self.config.multiview
        Rs, near = templates.poses.R, templates.flow
        start = _unsolved(templates.poses, templates.diameter_m)
        if not multiview:
            query = map_tensors(query, lambda x: x.repeat_interleave(views, 0))
            start = map_tensors(start, lambda x: x.flatten(0, 1)[:, None])
            near = map_tensors(near, lambda x: x.flatten(0, 1)[:, None])
            Rs = Rs.flatten(0, 1)[:, None]
        first = 1 if multiview else 0
        descriptors, points, coverage = (
            x.flatten(first, first + 1) for x in (templates.descriptors, templates.points, templates.coverage)
        )
        matches = self.matcher.match(query.descriptors, descriptors, points, coverage, query.coverage)
        iterations = ITERATIONS if flow else _SEARCH_ITERATIONS
        args = matches.points, query.places, matches.weights, query.half_tangent
        solved = poses = solve_poses(*args, start, iterations)
        followed = None
        if self.flow and flow:
            common = _common(solved)
            near = near.nearer_half(Rs, common.R[:, 0])
            followed = self.flow(query.flow_descriptors, query.flow_coverage, near, query.half_tangent, common)
            poses = map_tensors(followed.pose, lambda x: x.expand(-1, start.R.shape[1], *x.shape[2:]))
            poses = dataclasses.replace(poses, residuals=residuals_of(*args[:2], query.half_tangent, poses))
        if not multiview:
            solved, poses = (map_tensors(x, lambda y: y.squeeze(1).unflatten(0, (-1, views))) for x in (solved, poses))
        return InitialPoses(matches, solved, followed, poses)

    def maps_of(self, poses: SolvedPoses, templates: TemplateTokens) -> Float[Tensor, "batch views tokens 6"]:
        """Return the pose maps of each view's pose."""
        half_extent_at_depth_m = templates.diameter_m[:, None] / poses.log_scale.exp()
        pose = ViewPoses(poses.R, poses.centre, half_extent_at_depth_m)
        maps = encode_pose_maps(pose, self.reference(templates), self.config.map_cells, self.config.padding)
        return maps.flatten(2, 3)

    def support(
        self, query: QueryTokens, matches: Matches, poses: ViewPoses, diameter_m: Float[Tensor, "batch"]
    ) -> Float[Tensor, "batch views"]:
        """Return how much of what is seen is matched where each pose says, in [0, 1]; see `matches`."""
        pose = _unsolved(poses, diameter_m)
        # Not the trust, which is only relative.
        weights = query.coverage * matches.similarity.clamp(0, 1)
        return support(matches.points, query.places, weights, query.coverage, query.half_tangent, pose)

    @property
    def matches(self) -> bool:
        """Return whether poses can be solved from matches with all templates, without denoising."""
        return self.config.matching and self.config.template_pose and self.config.multiview

    def search(self, query: QueryTokens, templates: TemplateTokens) -> tuple[ViewPoses, Float[Tensor, "batch"]]:
        """Return the best pose solved from matches alone, and its support; for networks that match, see `matches`.

        A fraction of the cost of an answer: what a search over turns and starts goes by. Templates need not be fused.
        """
        first = self.initial_poses(query, templates, flow=False)
        half_extent_at_depth_m = templates.diameter_m[:, None] / first.solved.log_scale.exp()
        poses = ViewPoses(first.solved.R, first.solved.centre, half_extent_at_depth_m)
        support = self.support(query, first.matches, poses, templates.diameter_m)
        best, rows = support.argmax(dim=1), torch.arange(len(support), device=support.device)
        return map_tensors(poses, lambda x: x[rows, best]), support[rows, best]

    def reference(self, fused: TemplateTokens) -> ViewPoses:
        """Return what poses are relative to; leading dimensions (batch, views)."""
        if self.config.relative_pose:
            return fused.poses
        # Absolute poses are relative to a view from the front that is as wide as the part.
        R = torch.eye(3, device=fused.tokens.device).expand_as(fused.poses.R)
        half_extent_at_depth_m = fused.diameter_m[:, None].expand_as(fused.poses.half_extent_at_depth_m)
        return ViewPoses(R, torch.zeros_like(fused.poses.centre), half_extent_at_depth_m)

    # -- pieces -------------------------------------------------------------------------------------------------

    def _match_features(
        self, query: QueryTokens, fused: TemplateTokens, first: InitialPoses
    ) -> Float[Tensor, "batch views cells features"]:
        """Return what the decoder is told of each cell."""
        reference, views = self.reference(fused), fused.tokens.shape[1]
        matches, solved = first.matches, first.poses
        scale = fused.diameter_m[:, None] / reference.half_extent_at_depth_m
        if self.config.multiview:
            return matches.features(solved, reference, scale, query.coverage, query.places)
        reference = map_tensors(reference, lambda x: x.flatten(0, 1)[:, None])
        solved = map_tensors(solved, lambda x: x.flatten(0, 1)[:, None])
        coverage, places = (x.repeat_interleave(views, 0) for x in (query.coverage, query.places))
        features = matches.features(solved, reference, scale.flatten()[:, None], coverage, places)
        return features.squeeze(1).unflatten(0, (-1, views))

    def _flow_descriptors(self, features: FeatureMaps) -> Float[Tensor, "batch flow_cells width"]:
        if self.flow is None or features.narrow is None:
            return features.cells.new_zeros(len(features.cells), 0, self.config.flow_width)
        return self.flow.describe(features.narrow, features.cells)

    def _image_tokens(self, features: Float[Tensor, "batch channels h w"]) -> Float[Tensor, "batch tokens width"]:
        return self.embed_image(self._patches(features.flatten(2).mT)) + self.patch_position

    def _patches(self, cells: Float[Tensor, "*batch cells channels"]) -> Float[Tensor, "*batch tokens patch"]:
        """Return the cells of each token, one after the other."""
        s, p = self.stride, self.config.map_cells
        x = cells.unflatten(-2, (p, s, p, s)).movedim(-3, -4)  # (..., p, p, s, s, channels)
        return x.flatten(-3).flatten(-3, -2)

    def _coverage_and_places(
        self, masks: Float[Tensor, "batch size size"]
    ) -> tuple[Float[Tensor, "batch cells"], Float[Tensor, "batch cells 2"]]:
        size, cells = masks.shape[-1], self.config.local_cells
        pixels = cell_centres(size, device=masks.device).movedim(-1, 0)  # (2, size, size)
        channels = torch.cat([masks[:, None], masks[:, None] * pixels], dim=1)
        pooled = nn.functional.adaptive_avg_pool2d(channels, cells).flatten(2).mT  # (batch, cells, 3)
        coverage = pooled[..., 0]
        places = pooled[..., 1:] / coverage.clamp_min(1e-6)[..., None]
        centres = cell_centres(cells, device=masks.device).flatten(0, 1)
        return coverage, torch.where(coverage[..., None] > 1e-3, places, centres)


def _unsolved(poses: ViewPoses, diameter_m: Float[Tensor, "batch"]) -> SolvedPoses:
    """Return poses as the solver takes them; residuals come from solving."""
    log_scale = (diameter_m[:, None] / poses.half_extent_at_depth_m).log()
    return SolvedPoses(poses.R, poses.centre, log_scale, poses.centre.new_zeros(*log_scale.shape, 0, 2))


def _common(solved: SolvedPoses) -> SolvedPoses:
    """Return the one pose that most views' solutions agree on, as one view without gradient."""
    # In single precision, as they were solved.
    with torch.no_grad(), torch.autocast(solved.R.device.type, enabled=False):
        one = combine_views(ViewPoses(solved.R, solved.centre, (-solved.log_scale).exp()))
    R, centre, log_scale = one.R[:, None], one.centre[:, None], -one.half_extent_at_depth_m.log()[:, None]
    return SolvedPoses(R, centre, log_scale, solved.residuals[:, :1, :0])


def halved_geometry(
    points: Float[Tensor, "*batch cells 3"], coverage: Float[Tensor, "*batch cells"]
) -> tuple[Float[Tensor, "*batch quarter 3"], Float[Tensor, "*batch quarter"]]:
    """Return positions and coverage on a grid of half as many cells a side: means over what is covered."""
    side = math.isqrt(points.shape[-2])
    x = torch.cat([points * coverage[..., None], coverage[..., None]], dim=-1)
    x = x.unflatten(-2, (side // 2, 2, side // 2, 2)).mean(dim=(-4, -2)).flatten(-3, -2)
    covered = x[..., 3]
    return x[..., :3] / covered.clamp_min(1e-6)[..., None] * (covered > 1e-3)[..., None], covered


def _in_view(
    points: Float[Tensor, "batch views cells 3"], poses: ViewPoses, diameter_m: Float[Tensor, "batch"]
) -> Float[Tensor, "batch views cells 3"]:
    """Return positions turned into each view's frame, in half sides of its crop."""
    return (
        torch.einsum("bkij,bknj->bkni", poses.R, points)
        * (diameter_m[:, None] / poses.half_extent_at_depth_m)[..., None, None]
    )
