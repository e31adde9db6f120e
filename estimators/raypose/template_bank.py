"""`TemplateBank`: a part's templates as the network keeps them, each encoded once, when first needed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from simpick.assets.part import Part
from simpick.estimators.raypose.crops.template_choice import choose_around, spread_over_sphere
from simpick.estimators.raypose.crops.template_crops import collate, crop_templates
from simpick.estimators.raypose.network.flow import FlowCells
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import TemplateTokens
from simpick.geometry import SymmetryGroup, invert, transform_points
from simpick.rendering import TemplateSet

TURNS = 12
"""Turns of each view about the optical axis that templates around a pose are chosen from."""
_ENCODED_AT_ONCE = 64
_KEPT = 600
"""Slots of a part that are kept, those used last: some 85 MB of `small`."""


@dataclass(frozen=True, eq=False)
class _Slot:
    """One view in one turn."""

    tokens: Float[Tensor, "tokens width"]
    descriptors: Float[Tensor, "cells match_width"]
    points: Float[Tensor, "cells 3"]
    coverage: Float[Tensor, "cells"]
    flow_descriptors: Float[Tensor, "flow_cells flow_width"]
    flow_points: Float[Tensor, "flow_cells 3"]
    flow_coverage: Float[Tensor, "flow_cells"]
    T_crop_part: Float[np.ndarray, "4 4"]
    half_tangent: float


class TemplateBank:
    """The encoded templates of one part for one network."""

    def __init__(self, model: RayPose, part: Part, templates: TemplateSet) -> None:
        self._model, self._templates = model, templates
        self._symmetries: SymmetryGroup = part.symmetries
        self._diameter_m = part.diameter_m
        self._slots: dict[tuple[int, int], _Slot] = {}
        self._sphere: TemplateTokens | None = None

    @property
    def Rs_view_part(self) -> Float[np.ndarray, "views 3 3"]:
        """Return the orientations of the views, unturned."""
        return self._templates.Ts_camera_part[:, :3, :3]

    def over_sphere(self) -> TemplateTokens:
        """Return the fixed set of coarse templates, fused: the same for every query, so made once."""
        if self._sphere is None:
            views = spread_over_sphere(self.Rs_view_part, self._model.config.templates)
            slots = self._encoded([(int(view), 0) for view in views])
            reference = slots[0].T_crop_part
            self._sphere = self._model.fuse(_stack([self._posed(slots, reference)], self._diameter_m))
        return self._sphere

    def around(self, Ts_crop_part: Float[np.ndarray, "n 4 4"]) -> TemplateTokens:
        """Return for each pose the templates nearest to it, not fused; equivalent poses are told as nearest to it."""
        config = self._model.config
        # Of equivalent poses always the same one, so that equivalent starts have the same templates.
        Ts_crop_part = self._symmetries.closest_equivalent(Ts_crop_part, np.eye(4))
        chosen = [choose_around(self.Rs_view_part, T[:3, :3], config.templates, TURNS) for T in Ts_crop_part]
        keys = [[(int(v), int(t)) for v, t in zip(views, turns, strict=True)] for views, turns in chosen]
        slots = self._encoded([key for own in keys for key in own])
        own = np.cumsum([0, *map(len, keys)])
        sets = [self._posed(slots[own[k] : own[k + 1]], T) for k, T in enumerate(Ts_crop_part)]
        return _stack(sets, self._diameter_m)

    def _encoded(self, keys: list[tuple[int, int]]) -> list[_Slot]:
        missing = [key for key in dict.fromkeys(keys) if key not in self._slots]
        for start in range(0, len(missing), _ENCODED_AT_ONCE):
            self._encode(missing[start : start + _ENCODED_AT_ONCE])
        for key in keys:
            self._slots[key] = self._slots.pop(key)  # The last used come last.
        slots = [self._slots[key] for key in keys]
        for key in list(self._slots)[: max(0, len(self._slots) - _KEPT)]:
            del self._slots[key]
        return slots

    def _encode(self, keys: list[tuple[int, int]]) -> None:
        views: Int[np.ndarray, "n"] = np.array([view for view, _ in keys])
        angles = 2 * np.pi * np.array([turn for _, turn in keys]) / TURNS
        crops = crop_templates(self._templates, views, angles, self._model.config)
        tokens = self._model.encode_templates(collate([crops], [self._diameter_m]))
        for k, key in enumerate(keys):
            self._slots[key] = _Slot(
                tokens.tokens[0, k].clone(),
                tokens.descriptors[0, k].clone(),
                tokens.points[0, k],
                tokens.coverage[0, k],
                tokens.flow.descriptors[0, k].clone(),
                tokens.flow.points[0, k],
                tokens.flow.coverage[0, k],
                crops.Ts_crop_part[k],
                float(crops.half_tangent[k]),
            )

    def _posed(self, slots: list[_Slot], T_reference: Float[np.ndarray, "4 4"]) -> list[_Slot]:
        """Return the slots with those of their equivalent poses that are turned least against the reference."""
        if self._symmetries.is_trivial:
            return slots
        Ts = np.stack([slot.T_crop_part for slot in slots])
        new = self._symmetries.closest_equivalent(Ts, T_reference)
        Ts_new_old = invert(new) @ Ts
        posed = []
        for slot, T, T_new_old in zip(slots, new, Ts_new_old, strict=True):
            points = self._moved(slot.points, slot.coverage, T_new_old)
            flow_points = self._moved(slot.flow_points, slot.flow_coverage, T_new_old)
            posed.append(dataclasses.replace(slot, points=points, flow_points=flow_points, T_crop_part=T))
        return posed

    def _moved(
        self, points: Float[Tensor, "cells 3"], coverage: Float[Tensor, "cells"], T_new_old: Float[np.ndarray, "4 4"]
    ) -> Float[Tensor, "cells 3"]:
        moved = transform_points(T_new_old, self._diameter_m * points.double().numpy()) / self._diameter_m
        return torch.tensor(moved, dtype=torch.float32) * (coverage > 0)[:, None]


def _stack(sets: list[list[_Slot]], diameter_m: float) -> TemplateTokens:
    def stacked(name: str) -> Tensor:
        return torch.stack([torch.stack([getattr(slot, name) for slot in own]) for own in sets])

    Ts = torch.tensor(np.array([[slot.T_crop_part for slot in own] for own in sets]), dtype=torch.float32)
    half_tangent = torch.tensor([[slot.half_tangent for slot in own] for own in sets])
    return TemplateTokens(
        stacked("tokens"),
        stacked("descriptors"),
        stacked("points"),
        stacked("coverage"),
        ViewPoses.of(Ts, half_tangent),
        torch.full((len(sets),), diameter_m),
        FlowCells(stacked("flow_descriptors"), stacked("flow_points"), stacked("flow_coverage")),
    )
