"""`TemplateBank`: a part's templates as the network keeps them, each encoded once, when it is first needed."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from simpick.assets.part import Part
from simpick.estimators.raypose.crops.aimed_templates import aim_at_templates
from simpick.estimators.raypose.crops.template_choice import choose_around, spread_over_sphere
from simpick.estimators.raypose.crops.template_crops import TemplateImages, collate, crop_templates, move_points
from simpick.estimators.raypose.network.flow import FlowCells
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import TemplateTokens
from simpick.estimators.raypose.recent_views import RecentViews
from simpick.geometry import invert
from simpick.rendering import TemplateSet
from simpick.tensor_record import TensorRecord

TURNS = 12
"""Turns of each view about the optical axis that templates around a pose are chosen from."""
_ENCODED_AT_ONCE = 64
ViewKey = tuple[str, int, int]
"""Content hash of the part, number of the view, number of the turn."""


@dataclass(frozen=True, eq=False)
class EncodedView(TensorRecord):
    """Views in one turn each; leading dimensions are free: none for one view."""

    tokens: Float[Tensor, "*batch tokens width"]
    descriptors: Float[Tensor, "*batch cells match_width"]
    points: Float[Tensor, "*batch cells 3"]
    coverage: Float[Tensor, "*batch cells"]
    flow: FlowCells
    embedding: Float[Tensor, "*batch embedding"]
    half_tangent: Float[Tensor, "*batch"]
    Ts_crop_part: Float[np.ndarray, "*batch 4 4"]


NOT_MATCHED = ("tokens", "flow", "embedding")
"""Fields of views that matching does not need."""
NOT_FOLLOWED = ("tokens", "descriptors", "points", "coverage", "embedding")
"""Fields of views that flow does not need where matches are known."""


class TemplateBank:
    """The encoded templates of one part for one network."""

    def __init__(
        self,
        model: RayPose,
        part: Part,
        templates: TemplateSet,
        recent: RecentViews[ViewKey, EncodedView] | None = None,
    ) -> None:
        """Banks of one network may share the memory for views that were used last."""
        self._model, self.part, self._templates = model, part, templates
        self._images = TemplateImages.of(templates)
        self._recent = RecentViews[ViewKey, EncodedView]() if recent is None else recent
        self._sphere: TemplateTokens | None = None

    @property
    def Rs_view_part(self) -> Float[np.ndarray, "views 3 3"]:
        """Return the orientations of the views, unturned."""
        return self._templates.Ts_camera_part[:, :3, :3]

    def over_sphere(self) -> TemplateTokens:
        """Return the fixed set of coarse templates, fused: the same for every query, so made once."""
        if self._sphere is None:
            views = spread_over_sphere(self.Rs_view_part, self._model.config.templates)
            slots = EncodedView.stack(self._encoded([(int(view), 0) for view in views]))
            self._sphere = self._model.fuse(self._templates_of(self._posed(slots, slots.Ts_crop_part[0]), sets=1))
        return self._sphere

    def around(self, Ts_crop_part: Float[np.ndarray, "n 4 4"], *, without: Collection[str] = ()) -> TemplateTokens:
        """Return for each pose the templates nearest to it, not fused, each in its equivalent pose nearest to it.

        Fields of the views in `without` are left empty, which saves copying them.
        """
        config = self._model.config
        # Of equivalent poses always the same one, so that equivalent starts have the same templates.
        Ts_crop_part = self.part.symmetries.closest_equivalent(Ts_crop_part, np.eye(4))
        chosen = [choose_around(self.Rs_view_part, T[:3, :3], config.templates, TURNS) for T in Ts_crop_part]
        keys = [(int(v), int(t)) for views, turns in chosen for v, t in zip(views, turns, strict=True)]
        count = len(keys) // len(chosen)
        slots = EncodedView.stack(self._encoded(keys), without=without)
        return self._templates_of(self._posed(slots, np.repeat(Ts_crop_part, count, axis=0)), sets=len(chosen))

    def _encoded(self, keys: list[tuple[int, int]]) -> list[EncodedView]:
        return self._recent.get([(self.part.content_hash, *key) for key in keys], self._make)

    def _make(self, keys: list[ViewKey]) -> list[EncodedView]:
        starts = range(0, len(keys), _ENCODED_AT_ONCE)
        return [view for start in starts for view in self._encode(keys[start : start + _ENCODED_AT_ONCE])]

    def _encode(self, keys: list[ViewKey]) -> list[EncodedView]:
        views: Int[np.ndarray, "n"] = np.array([view for _, view, _ in keys])
        angles = 2 * np.pi * np.array([turn for *_, turn in keys]) / TURNS
        aimed = aim_at_templates(self._templates, views, angles, self._model.config)
        crops = crop_templates(self._images, aimed, self._model.config)
        encoded = self._model.encode_templates(collate([crops], [self.part.diameter_m]))
        slots = EncodedView(
            encoded.tokens[0],
            encoded.descriptors[0],
            encoded.points[0],
            encoded.coverage[0],
            encoded.flow.map(lambda x: x[0]),
            encoded.embedding[0],
            torch.tensor(crops.half_tangent, dtype=torch.float32),
            crops.Ts_crop_part,
        )
        # Copies, so that a slot does not keep those that were encoded with it.
        return [slots.rows(k).map(Tensor.clone) for k in range(len(keys))]

    def _posed(self, slots: EncodedView, T_reference: Float[np.ndarray, "*#batch 4 4"]) -> EncodedView:
        """Return the slots with those of their equivalent poses that are rotated least against their reference."""
        if self.part.symmetries.is_trivial:
            return slots
        Ts = self.part.symmetries.closest_equivalent(slots.Ts_crop_part, T_reference)
        Ts_new_old = invert(Ts) @ slots.Ts_crop_part
        Ts_new_old[:, :3, 3] /= self.part.diameter_m
        points = move_points(slots.points, slots.coverage, Ts_new_old)
        flow = replace(slots.flow, points=move_points(slots.flow.points, slots.flow.coverage, Ts_new_old))
        return replace(slots, points=points, flow=flow, Ts_crop_part=Ts)

    def _templates_of(self, slots: EncodedView, sets: int) -> TemplateTokens:
        """Return the slots as equally large sets, one set after the other."""
        slots = slots.split_rows(sets)
        return TemplateTokens(
            slots.tokens,
            slots.descriptors,
            slots.points,
            slots.coverage,
            ViewPoses.of(torch.tensor(slots.Ts_crop_part, dtype=torch.float32), slots.half_tangent),
            torch.full(slots.half_tangent.shape, self.part.diameter_m),
            slots.flow,
            slots.embedding,
        )
