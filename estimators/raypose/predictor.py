"""`Predictor`: poses of queries relative to their templates, a few queries at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from simpick.estimators.raypose.diffusion.schedule import make_schedule
from simpick.estimators.raypose.network.consensus import consensus_pose, consensus_score
from simpick.estimators.raypose.network.initial_poses import InitialPoses
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.pose_solver import SolvedPoses
from simpick.estimators.raypose.network.tokens import QueryTokens, TemplateTokens
from simpick.estimators.raypose.sample_views import sample_views
from simpick.tensor_record import TensorRecord

_AT_ONCE = 32
"""Queries that are compared with their templates at a time: some 250 MB with `small`."""
_FEWEST_STEPS = 3

TemplatesOf = Callable[[Int[np.ndarray, "m"]], TemplateTokens]
"""Returns the templates of some of the rows, by their positions in the rows."""


@dataclass(frozen=True, eq=False)
class Searched(TensorRecord):
    """Poses from matches alone, which rank candidates well enough."""

    initial: InitialPoses
    """Without the logits of matches, which are large."""
    poses: ViewPoses
    """The view that has most support."""
    scores: Float[Tensor, "n"]
    """Its support, in [0, 1]."""


class Predictor:
    """A network with its sampling schedule. The same queries give the same poses."""

    def __init__(self, model: RayPose, steps: int, seed: int) -> None:
        # A network that solves no matches has poses only from denoising.
        self._model, self._seed = model, seed
        self._steps = steps if model.solves_matches else max(steps, _FEWEST_STEPS)
        self._schedule = make_schedule()

    @property
    def follows_matches(self) -> bool:
        """Return whether final poses follow from matches and flow, without denoising."""
        return self._model.solves_matches and self._steps == 0

    def predict(
        self, queries: QueryTokens, rows: Int[np.ndarray, "n"], templates_of: TemplatesOf, *, final: bool
    ) -> tuple[ViewPoses, Float[np.ndarray, "n"]]:
        """Return one pose for each of these rows of the queries, and its score in [0, 1].

        Poses that are not `final` are those of `search`; final ones follow the flow too, and are denoised if there are
        denoising steps. Networks that solve no matches always denoise.
        """
        if self._model.solves_matches and not final:
            searched = self.search(queries, rows, templates_of)
            return searched.poses, searched.scores.numpy()
        predict = self._follow if self.follows_matches else self._denoise
        return _joined([predict(queries.rows(rows[k]), templates_of(k)) for k in _chunks(rows)])

    def search(self, queries: QueryTokens, rows: Int[np.ndarray, "n"], templates_of: TemplatesOf) -> Searched:
        """Return poses from matches alone for each of these rows, for networks that `solves_matches`."""
        return Searched.cat([self._searched(queries.rows(rows[k]), templates_of(k)) for k in _chunks(rows)])

    def follow(
        self, queries: QueryTokens, rows: Int[np.ndarray, "n"], templates_of: TemplatesOf, searched: Searched
    ) -> tuple[ViewPoses, Float[np.ndarray, "n"]]:
        """Return final poses as `predict` does, from what was searched with the same templates.

        For predictors that `follows_matches`. Of the templates, poses and flow's cells are needed.
        """
        found = []
        for k in _chunks(rows):
            chunk, templates = queries.rows(rows[k]), templates_of(k)
            found.append(self._answer(self._model.follow(chunk, templates, searched.initial.rows(k)), chunk, templates))
        return _joined(found)

    def _searched(self, queries: QueryTokens, templates: TemplateTokens) -> Searched:
        initial = self._model.search(queries, templates)
        support = initial.support(queries, initial.poses)
        best, rows = support.argmax(dim=1), torch.arange(len(support), device=support.device)
        poses = initial.poses.views(templates.diameter_m).map(lambda x: x[rows, best])
        matches = replace(initial.matches, logits=initial.matches.logits[..., :0])
        return Searched(replace(initial, matches=matches), poses, support[rows, best])

    def _follow(self, queries: QueryTokens, templates: TemplateTokens) -> tuple[ViewPoses, Float[Tensor, "m"]]:
        return self._answer(self._model.initial_poses(queries, templates, covered_only=True), queries, templates)

    def _answer(
        self, initial: InitialPoses, queries: QueryTokens, templates: TemplateTokens
    ) -> tuple[ViewPoses, Float[Tensor, "m"]]:
        pose = consensus_pose(initial.poses.views(templates.diameter_m))
        return pose, self._support(initial, queries, templates, pose)

    @staticmethod
    def _support(
        initial: InitialPoses, queries: QueryTokens, templates: TemplateTokens, pose: ViewPoses
    ) -> Float[Tensor, "m"]:
        solved = SolvedPoses.of(pose.map(lambda x: x[:, None]), templates.diameter_m[:, :1])
        return initial.support(queries, solved)[:, 0]

    def _denoise(self, queries: QueryTokens, templates: TemplateTokens) -> tuple[ViewPoses, Float[Tensor, "m"]]:
        fused = templates if templates.keys_values else self._model.fuse(templates)
        conditioning = self._model.condition(queries, fused)
        generator = torch.Generator().manual_seed(self._seed)
        views = sample_views(self._model, conditioning, self._schedule, self._steps, generator)
        pose = consensus_pose(views)
        if conditioning.initial is None or not self._model.solves_matches:
            return pose, consensus_score(views)
        return pose, self._support(conditioning.initial, queries, templates, pose)


def _chunks(rows: Int[np.ndarray, "n"]) -> list[Int[np.ndarray, "_"]]:
    return np.split(np.arange(len(rows)), range(_AT_ONCE, len(rows), _AT_ONCE))


def _joined(found: Sequence[tuple[ViewPoses, Float[Tensor, "_"]]]) -> tuple[ViewPoses, Float[np.ndarray, "n"]]:
    poses, scores = zip(*found, strict=True)
    return ViewPoses.cat(poses), torch.cat(scores).numpy()
