"""`RayPose`: the whole network. Templates are encoded once, a query once, and only the decoder runs at every step."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from simpick.estimators.raypose.network.cell_geometry import (
    cell_means,
    cells_per_token,
    coarser_geometry,
    coverage_and_centroids,
)
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.decoder import Decoder
from simpick.estimators.raypose.network.encoders.convolutional_encoder import ConvolutionalEncoder
from simpick.estimators.raypose.network.encoders.feature_maps import FeatureMaps
from simpick.estimators.raypose.network.encoders.image_encoder import make_image_encoder
from simpick.estimators.raypose.network.encoders.view_embedding import ViewEmbedding
from simpick.estimators.raypose.network.encoders.view_encoder import ViewEncoder
from simpick.estimators.raypose.network.encoders.visibility import VisibilityHead
from simpick.estimators.raypose.network.flow import FlowCells, TemplateFlow
from simpick.estimators.raypose.network.initial_poses import InitialPoses, follow_matches, initial_poses
from simpick.estimators.raypose.network.layers import KeysValues, SelfAttentionBlock, mlp
from simpick.estimators.raypose.network.matching import FEATURES, Matcher
from simpick.estimators.raypose.network.pose_maps import CHANNELS, ViewPoses, encode_pose_maps
from simpick.estimators.raypose.network.pose_solver import ITERATIONS, SolvedPoses
from simpick.estimators.raypose.network.tokens import QueryInputs, QueryTokens, TemplateInputs, TemplateTokens
from simpick.tensor_record import TensorRecord

_SEARCH_ITERATIONS = 4
"""Enough to distinguish a rotation that fits from one that does not."""


@dataclass(frozen=True, eq=False)
class Conditioning(TensorRecord):
    """All that the decoder needs beside noisy maps: the same at every step.

    A group is a query with all its templates, or without multiview with one of them.
    """

    tokens: Float[Tensor, "groups views tokens width"]
    context: tuple[KeysValues, ...]
    """Of query and templates, for each decoder block."""
    initial_maps: Float[Tensor, "groups views tokens 6"]
    """Maps that the decoder corrects: those of the initial poses, or of "same pose as the reference"."""
    reference: ViewPoses
    """The views that maps are relative to; leading dimensions (batch, views)."""
    initial: InitialPoses | None
    """By group; None without matching."""


class RayPose(nn.Module):
    """Query encoder, template encoder with multiview fuser, and diffusion transformer decoder (paper, fig. 2).

    Departures from the paper: a small image encoder that is trained too, masks that may be wrong instead of cut-outs,
    matching and flow before the decoder, geometry of templates beside their poses, and plain transformer blocks in the
    fuser.
    """

    def __init__(self, config: RayPoseConfig) -> None:
        super().__init__()
        self.config = config
        cells, width = config.map_cells, config.width
        patch = (config.local_cells // cells) ** 2
        self.image_encoder = make_image_encoder(config)
        self.view_encoder = ViewEncoder(cells, width, config.fourier_bands, config.padding)
        self.embed_image = nn.Linear(patch * config.local_width, width)
        self.embed_geometry = nn.Linear(patch * 4, width)
        self.patch_position = nn.Parameter(0.02 * torch.randn(cells * cells, width))
        self.view_position = nn.Parameter(0.02 * torch.randn(config.templates, width))
        self.fuser = nn.Sequential(*(SelfAttentionBlock(width, config.heads) for _ in range(config.fuser_blocks)))
        self.matcher = Matcher(config.local_width, config.match_width)
        fine_width = self.image_encoder.fine_width if isinstance(self.image_encoder, ConvolutionalEncoder) else 0
        self.view_embedding = ViewEmbedding(config.local_width)
        self.visibility = VisibilityHead(fine_width, config.local_width) if fine_width else None
        self.flow = TemplateFlow(config, fine_width) if config.flow else None
        self.embed_matches = nn.Sequential(nn.Linear(patch * FEATURES, width), mlp(width, 2))
        self.decoder = Decoder(config)

    @property
    def solves_matches(self) -> bool:
        """Return whether poses can be solved from matches with all templates, without denoising."""
        return self.config.matching and self.config.template_pose and self.config.multiview

    def encode_query(self, inputs: QueryInputs) -> QueryTokens:
        """Return a query's tokens and descriptors: of image and box only, since its pose is unknown."""
        features = self.image_encoder(inputs.rgb, inputs.masks)
        coverage, centroids = coverage_and_centroids(inputs.masks, self.config.local_cells)
        visible = coverage[:, :0]
        if self.visibility is not None and features.fine is not None:
            visible = self.visibility(features.fine, features.coarse, inputs.masks)
            coverage = cell_means(visible)
        return QueryTokens(
            self._image_tokens(features.coarse) + self.view_encoder.encode_box(inputs.half_tangent),
            self.matcher.describe(features.coarse),
            coverage,
            centroids,
            inputs.half_tangent,
            self._flow_descriptors(features),
            visible,
            self.view_embedding(features.coarse),
        )

    def encode_templates(self, inputs: TemplateInputs) -> TemplateTokens:
        """Return tokens and descriptors of templates' images; their poses enter in `fuse`."""
        batch, views = inputs.coverage.shape[:2]
        features = self.image_encoder(inputs.rgb.flatten(0, 1), inputs.masks.flatten(0, 1))
        tokens = self._image_tokens(features.coarse) + self.view_encoder.encode_box(inputs.half_tangent.flatten())
        points, coverage = inputs.points, inputs.coverage
        if self.flow:
            points, coverage = coarser_geometry(points, coverage)
        finest = slice(None) if self.flow else slice(0)
        fine = FlowCells(
            self._flow_descriptors(features).unflatten(0, (batch, views)),
            inputs.points[:, :, finest],
            inputs.coverage[:, :, finest],
        )
        return TemplateTokens(
            tokens.unflatten(0, (batch, views)),
            self.matcher.describe(features.coarse).unflatten(0, (batch, views)),
            points,
            coverage,
            inputs.poses,
            inputs.diameter_m[:, None].expand(-1, views),
            fine,
            self.view_embedding(features.coarse).unflatten(0, (batch, views)),
        )

    def embed_views(
        self, rgb: Float[Tensor, "views 3 size size"], masks: Float[Tensor, "views size size"]
    ) -> Float[Tensor, "views embedding"]:
        """Return only the embeddings of crops of templates, as `encode_templates` gives them with the rest."""
        return self.view_embedding(self.image_encoder(rgb, masks).coarse)

    def fuse(self, templates: TemplateTokens) -> TemplateTokens:
        """Return the templates with view embeddings added and fused over all views (E_V and E_F of the paper).

        Their keys and values for the decoder are computed too: they depend on no query.
        """
        views, poses = templates.tokens.shape[1], templates.poses
        tokens = templates.tokens + self.view_position[:views, None]  # (batch, views, tokens, width)
        if self.config.template_pose:
            flat = poses.map(lambda x: x.flatten(0, 1))
            posed = self.view_encoder.encode_pose(flat, templates.diameter_m.flatten()).unflatten(0, (-1, views))
            scale = (templates.diameter_m / poses.half_extent_at_depth_m)[..., None, None]
            points = torch.einsum("bkij,bknj->bkni", poses.R, templates.points) * scale
            geometry = torch.cat([points, templates.coverage[..., None]], dim=-1)
            tokens = tokens + posed + self.embed_geometry(self._patches(geometry))
        groups = tokens.flatten(1, 2)[:, None] if self.config.multiview else tokens
        fused = self.fuser(groups)  # (batch, groups, tokens, width)
        return dataclasses.replace(
            templates, tokens=fused.reshape(tokens.shape), keys_values=self.decoder.keys_values(fused)
        )

    def condition(self, query: QueryTokens, templates: TemplateTokens) -> Conditioning:
        """Return what the decoder needs; the templates are fused, one set for each query."""
        reference = self.reference(templates)
        query, templates = self._groups(query, templates)
        tokens = query.tokens[:, None] + templates.tokens
        initial_maps = self.decoder.neutral.expand(*tokens.shape[:-1], CHANNELS)
        initial = None
        if self.config.matching and self.config.template_pose:
            initial = initial_poses(self.matcher, self.flow, query, templates)
            features = initial.features(query, self.reference(templates), templates.diameter_m)
            tokens = tokens + self.embed_matches(self._patches(features))
            initial_maps = self.pose_maps(initial.poses, templates).flatten(2, 3)
        context = tuple(
            (torch.cat([k, template_k[:, 0]], dim=2), torch.cat([v, template_v[:, 0]], dim=2))
            for (k, v), (template_k, template_v) in zip(
                self.decoder.keys_values(query.tokens), templates.keys_values, strict=True
            )
        )
        return Conditioning(tokens, context, initial_maps, reference, initial)

    def denoise(
        self, maps: Float[Tensor, "batch views p p 6"], log_snr: Float[Tensor, "batch"], conditioning: Conditioning
    ) -> Float[Tensor, "batch views p p 6"]:
        """Return the clean maps that noisy ones come from: M_0 of the paper."""
        noisy = maps.reshape(conditioning.initial_maps.shape)
        log_snr = log_snr.repeat_interleave(len(noisy) // len(maps))
        clean = self.decoder(noisy, log_snr, conditioning.tokens, conditioning.initial_maps, conditioning.context)
        return clean.reshape(maps.shape)

    def initial_poses(
        self, query: QueryTokens, templates: TemplateTokens, *, covered_only: bool = False
    ) -> InitialPoses:
        """Return initial poses by group; templates need not be fused. `covered_only` is for answers, not for losses."""
        return initial_poses(self.matcher, self.flow, *self._groups(query, templates), covered_only=covered_only)

    def search(self, query: QueryTokens, templates: TemplateTokens) -> InitialPoses:
        """Return poses solved from matches alone, in few iterations, for networks that `solves_matches`.

        They cost a fraction of an answer and rank rotations and starts. Templates need not be fused.
        """
        return initial_poses(self.matcher, None, query, templates, _SEARCH_ITERATIONS, covered_only=True)

    def follow(self, query: QueryTokens, templates: TemplateTokens, searched: InitialPoses) -> InitialPoses:
        """Return what `initial_poses` does, from what `search` found with the same templates."""
        return follow_matches(self.flow, query, templates, searched, ITERATIONS - _SEARCH_ITERATIONS)

    def pose_maps(self, poses: SolvedPoses, templates: TemplateTokens) -> Float[Tensor, "batch views p p 6"]:
        """Return the maps of each view's pose relative to its reference."""
        views = poses.views(templates.diameter_m)
        return encode_pose_maps(views, self.reference(templates), self.config.map_cells, self.config.padding)

    def reference(self, templates: TemplateTokens) -> ViewPoses:
        """Return the views that poses are relative to; leading dimensions (batch, views)."""
        if self.config.relative_pose:
            return templates.poses
        # Absolute poses are relative to a view from the front that is as wide as the part.
        R = torch.eye(3, device=templates.tokens.device).expand_as(templates.poses.R)
        return ViewPoses(R, torch.zeros_like(templates.poses.centre), templates.diameter_m)

    def _groups(self, query: QueryTokens, templates: TemplateTokens) -> tuple[QueryTokens, TemplateTokens]:
        """Return each query with all its templates, or without multiview once with each of them."""
        if self.config.multiview:
            return query, templates
        views = templates.tokens.shape[1]
        own = query.map(lambda x: x.repeat_interleave(views, 0))
        return own, templates.map(lambda x: x.flatten(0, 1)[:, None])

    def _flow_descriptors(self, features: FeatureMaps) -> Float[Tensor, "batch flow_cells width"]:
        if self.flow is None or features.fine is None:
            return features.coarse.new_zeros(len(features.coarse), 0, self.config.flow_width)
        return self.flow.describe(features.fine, features.coarse)

    def _image_tokens(self, features: Float[Tensor, "batch channels h w"]) -> Float[Tensor, "batch tokens width"]:
        return self.embed_image(self._patches(features.flatten(2).mT)) + self.patch_position

    def _patches(self, cells: Float[Tensor, "*batch cells channels"]) -> Float[Tensor, "*batch tokens patch"]:
        return cells_per_token(cells, self.config.map_cells)
