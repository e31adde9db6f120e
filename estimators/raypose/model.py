"""`RayPose`: the whole network. Templates are encoded once, a query once, and only the decoder runs at every step."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from simpick.estimators.raypose.config import RayPoseConfig
from simpick.estimators.raypose.decoder import Decoder
from simpick.estimators.raypose.image_encoder import make_image_encoder
from simpick.estimators.raypose.layers import KeysValues, SelfAttentionBlock, mlp
from simpick.estimators.raypose.matching import FEATURES, Matcher, Matches
from simpick.estimators.raypose.pose_maps import CHANNELS, ViewPoses, cell_centres, encode_pose_maps
from simpick.estimators.raypose.pose_solver import ITERATIONS, SolvedPoses, solve_poses, support
from simpick.estimators.raypose.view_encoder import ViewEncoder

_SEARCH_ITERATIONS = 4
"""Enough to tell a turn that fits from one that does not."""


@dataclass(frozen=True, eq=False)
class QueryInputs:
    """Crops of detections; all that is known of them."""

    rgb: Float[Tensor, "batch 3 size size"]
    """In [0, 1]."""
    masks: Float[Tensor, "batch size size"]
    half_tangent: Float[Tensor, "batch"]
    """Tangent of half the crop's angle."""


@dataclass(frozen=True, eq=False)
class TemplateInputs:
    """Crops of rendered views with their poses and geometry."""

    rgb: Float[Tensor, "batch views 3 size size"]
    masks: Float[Tensor, "batch views size size"]
    half_tangent: Float[Tensor, "batch views"]
    poses: ViewPoses
    """Leading dimensions (batch, views)."""
    points: Float[Tensor, "batch views cells 3"]
    """Mean position in the part's frame of what each cell shows, in diameters; 0 where it shows nothing."""
    coverage: Float[Tensor, "batch views cells"]
    """Share of each cell that the part covers."""
    diameter_m: Float[Tensor, "batch"]


@dataclass(frozen=True, eq=False)
class TemplateTokens:
    """What is kept of templates: made once, for any query."""

    tokens: Float[Tensor, "batch views tokens width"]
    descriptors: Float[Tensor, "batch views cells match_width"]
    points: Float[Tensor, "batch views cells 3"]
    coverage: Float[Tensor, "batch views cells"]
    poses: ViewPoses
    diameter_m: Float[Tensor, "batch"]
    kv: Sequence[KeysValues] = ()
    """Once fused: each decoder block's keys and values of the tokens; without multiview, one group a template."""

    def for_queries(self, sets: Int[Tensor, "queries"]) -> TemplateTokens:
        """Return for each query the set of templates that it is compared with."""
        views = self.tokens.shape[1]

        def chosen(x: Tensor) -> Tensor:
            if len(x) == len(self.tokens):
                # One set for all is not copied.
                return x.expand(len(sets), *x.shape[1:]) if len(x) == 1 else x[sets]
            return chosen(x.unflatten(0, (-1, views))).flatten(0, 1)

        kv = [(chosen(k), chosen(v)) for k, v in self.kv]
        tensors = {n: chosen(getattr(self, n)) for n in ("tokens", "descriptors", "points", "coverage", "diameter_m")}
        return dataclasses.replace(self, poses=_map(self.poses, chosen), kv=kv, **tensors)


@dataclass(frozen=True, eq=False)
class QueryTokens:
    """What is kept of a query."""

    tokens: Float[Tensor, "batch tokens width"]
    descriptors: Float[Tensor, "batch cells match_width"]
    coverage: Float[Tensor, "batch cells"]
    places: Float[Tensor, "batch cells 2"]
    """Mean place of each cell's pixels of the mask, in half crop sides: matched points are means over them."""
    half_tangent: Float[Tensor, "batch"]


@dataclass(frozen=True, eq=False)
class Conditioning:
    """All that the decoder needs beside noisy maps: the same at every step."""

    base: Float[Tensor, "groups views tokens width"]
    """Without multiview, every template is a group of its own."""
    kv: Sequence[KeysValues]
    reference: ViewPoses
    """What poses are relative to; leading dimensions (batch, views)."""
    first: Float[Tensor, "groups views tokens 6"]
    """Maps that the decoder corrects: those of the pose solved from matches, or of "same pose as the reference"."""
    matches: Matches | None


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
        self.embed_matches = nn.Sequential(nn.Linear(patch * FEATURES, width), mlp(width, 2))
        self.decoder = Decoder(config)

    def encode_query(self, inputs: QueryInputs) -> QueryTokens:
        """Return a query's tokens and descriptors: image and box, since its pose is what is asked for."""
        features = self.image_encoder(inputs.rgb, inputs.masks)  # (batch, local width, cells, cells)
        tokens = self._image_tokens(features) + self.view_encoder.encode_box(inputs.half_tangent)
        coverage, places = self._coverage_and_places(inputs.masks)
        return QueryTokens(tokens, self.matcher.describe(features), coverage, places, inputs.half_tangent)

    def encode_templates(self, inputs: TemplateInputs) -> TemplateTokens:
        """Return what templates' images say: tokens and descriptors, before poses are told."""
        batch, views = inputs.coverage.shape[:2]
        features = self.image_encoder(inputs.rgb.flatten(0, 1), inputs.masks.flatten(0, 1))
        tokens = self._image_tokens(features) + self.view_encoder.encode_box(inputs.half_tangent.flatten())
        return TemplateTokens(
            tokens.unflatten(0, (batch, views)),
            self.matcher.describe(features).unflatten(0, (batch, views)),
            inputs.points,
            inputs.coverage,
            inputs.poses,
            inputs.diameter_m,
        )

    def fuse(self, templates: TemplateTokens) -> TemplateTokens:
        """Return the templates with their poses told and after all views have seen one another (E_V and E_F).

        With their keys and values for the decoder, which depend on no query.
        """
        views, poses = templates.tokens.shape[1], templates.poses
        tokens = templates.tokens + self.view_position[:views, None]
        if self.config.template_pose:
            flat = ViewPoses(poses.R.flatten(0, 1), poses.centre.flatten(0, 1), poses.reach_m.flatten())
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
        matches = None
        if self.config.matching and self.config.template_pose:
            matches, solved = self._match(query, fused)
            base = base + self.embed_matches(self._patches(self._match_features(query, fused, matches, solved)))
            first = self._maps_of(solved, reference, fused.diameter_m)
        own = query.tokens
        if not self.config.multiview:
            base, first = base.flatten(0, 1)[:, None], first.flatten(0, 1)[:, None]
            own = own.repeat_interleave(views, 0)
        kv = [
            (torch.cat([k, template_k], dim=2), torch.cat([v, template_v], dim=2))
            for (k, v), (template_k, template_v) in zip(self.decoder.keys_values(own), fused.kv, strict=True)
        ]
        return Conditioning(base, kv, reference, first, matches)

    def denoise(
        self, maps: Float[Tensor, "batch views p p 6"], log_snr: Float[Tensor, "batch"], conditioning: Conditioning
    ) -> Float[Tensor, "batch views p p 6"]:
        """Return the clean maps that noisy ones come from."""
        shape = maps.shape
        noisy = maps.flatten(2, 3)
        if not self.config.multiview:
            noisy, log_snr = noisy.flatten(0, 1)[:, None], log_snr.repeat_interleave(shape[1])
        return self.decoder(noisy, log_snr, conditioning.base, conditioning.first, conditioning.kv).reshape(shape)

    def first_maps(
        self, query: QueryTokens, templates: TemplateTokens
    ) -> tuple[Matches, Float[Tensor, "batch views tokens 6"]]:
        """Return matches and the maps of the pose solved from them, for which templates need not be fused."""
        matches, solved = self._match(query, templates)
        return matches, self._maps_of(solved, self.reference(templates), templates.diameter_m)

    def support(
        self, query: QueryTokens, matches: Matches, poses: ViewPoses, diameter_m: Float[Tensor, "batch"]
    ) -> Float[Tensor, "batch views"]:
        """Return how much of what is seen is matched where each pose says, in [0, 1]; multiview networks only."""
        pose = _unsolved(poses, diameter_m)
        # Not the trust, which is only relative.
        weights = query.coverage * matches.likeness.clamp(0, 1)
        return support(matches.points, query.places, weights, query.coverage, query.half_tangent, pose)

    def first_support(self, query: QueryTokens, fused: TemplateTokens) -> Float[Tensor, "batch"]:
        """Return the support of the best pose solved from matches alone: what a search over turns goes by."""
        matches, solved = self._match(query, fused, _SEARCH_ITERATIONS)
        reach_m = fused.diameter_m[:, None] / solved.log_scale.exp()
        poses = ViewPoses(solved.R, solved.centre, reach_m)
        return self.support(query, matches, poses, fused.diameter_m).amax(dim=1)

    def reference(self, fused: TemplateTokens) -> ViewPoses:
        """Return what poses are relative to; leading dimensions (batch, views)."""
        if self.config.relative_pose:
            return fused.poses
        # Absolute poses are relative to a view from the front that is as wide as the part.
        R = torch.eye(3, device=fused.tokens.device).expand_as(fused.poses.R)
        reach_m = fused.diameter_m[:, None].expand_as(fused.poses.reach_m)
        return ViewPoses(R, torch.zeros_like(fused.poses.centre), reach_m)

    # -- pieces -------------------------------------------------------------------------------------------------

    def _match(
        self, query: QueryTokens, fused: TemplateTokens, iterations: int = ITERATIONS
    ) -> tuple[Matches, SolvedPoses]:
        """Return matches, and the pose solved from them from each template's own.

        Without multiview, every template is a query's only one: as many groups as templates, of one view each.
        """
        views, multiview = fused.tokens.shape[1], self.config.multiview
        start = _unsolved(fused.poses, fused.diameter_m)
        if not multiview:
            query = _map(query, lambda x: x.repeat_interleave(views, 0))
            start = _map(start, lambda x: x.flatten(0, 1)[:, None])
        first = 1 if multiview else 0
        descriptors, points, coverage = (
            x.flatten(first, first + 1) for x in (fused.descriptors, fused.points, fused.coverage)
        )
        matches = self.matcher.match(query.descriptors, descriptors, points, coverage, query.coverage)
        solved = solve_poses(matches.points, query.places, matches.weights, query.half_tangent, start, iterations)
        return matches, solved if multiview else _map(solved, lambda x: x.squeeze(1).unflatten(0, (-1, views)))

    def _match_features(
        self, query: QueryTokens, fused: TemplateTokens, matches: Matches, solved: SolvedPoses
    ) -> Float[Tensor, "batch views cells features"]:
        """Return what the decoder is told of each cell."""
        reference, views = self.reference(fused), fused.tokens.shape[1]
        scale = fused.diameter_m[:, None] / reference.reach_m
        if self.config.multiview:
            return matches.features(solved, reference, scale, query.coverage, query.places)
        reference = _map(reference, lambda x: x.flatten(0, 1)[:, None])
        solved = _map(solved, lambda x: x.flatten(0, 1)[:, None])
        coverage, places = (x.repeat_interleave(views, 0) for x in (query.coverage, query.places))
        features = matches.features(solved, reference, scale.flatten()[:, None], coverage, places)
        return features.squeeze(1).unflatten(0, (-1, views))

    def _maps_of(
        self, solved: SolvedPoses, reference: ViewPoses, diameter_m: Float[Tensor, "batch"]
    ) -> Float[Tensor, "batch views tokens 6"]:
        reach_m = diameter_m[:, None] / solved.log_scale.exp()
        pose = ViewPoses(solved.R, solved.centre, reach_m)
        return encode_pose_maps(pose, reference, self.config.map_cells, self.config.padding).flatten(2, 3)

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
    log_scale = (diameter_m[:, None] / poses.reach_m).log()
    return SolvedPoses(poses.R, poses.centre, log_scale, poses.centre.new_zeros(*log_scale.shape, 0, 2))


def _in_view(
    points: Float[Tensor, "batch views cells 3"], poses: ViewPoses, diameter_m: Float[Tensor, "batch"]
) -> Float[Tensor, "batch views cells 3"]:
    """Return positions turned into each view's frame, in half sides of its crop."""
    return torch.einsum("bkij,bknj->bkni", poses.R, points) * (diameter_m[:, None] / poses.reach_m)[..., None, None]


_Record = TypeVar("_Record", QueryTokens, SolvedPoses, ViewPoses)


def _map(record: _Record, function: Callable[[Tensor], Tensor]) -> _Record:
    """Return a record of tensors with the function applied to each."""
    return type(record)(*(function(getattr(record, field.name)) for field in dataclasses.fields(record)))
