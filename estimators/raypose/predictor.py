"""`Predictor`: poses of queries relative to their templates, a few queries at a time."""

from __future__ import annotations

from collections.abc import Callable

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

_AT_ONCE = 32
"""Queries that are compared with their templates at a time: some 250 MB with `small`."""
_FEWEST_STEPS = 3


class Predictor:
    """A network with its sampling schedule. The same queries give the same poses."""

    def __init__(self, model: RayPose, steps: int, seed: int) -> None:
        # A network that solves no matches has poses only from denoising.
        self._model, self._seed = model, seed
        self._steps = steps if model.solves_matches else max(steps, _FEWEST_STEPS)
        self._schedule = make_schedule()

    def predict(
        self,
        queries: QueryTokens,
        rows: Int[np.ndarray, "n"],
        templates_of: Callable[[Int[np.ndarray, "m"]], TemplateTokens],
        *,
        final: bool,
    ) -> tuple[ViewPoses, Float[np.ndarray, "n"]]:
        """Return one pose for each of these rows of the queries, and its score in [0, 1].

        `templates_of` returns the templates of some of `rows`, by their positions in `rows`. Poses that are not `final`
        are solved from matches alone, which ranks candidates well enough; final ones follow the flow too, and are
        denoised if there are denoising steps. Networks that solve no matches always denoise.
        """
        chunks = np.split(np.arange(len(rows)), range(_AT_ONCE, len(rows), _AT_ONCE))
        predict = self._denoise
        if self._model.solves_matches and not final:
            predict = self._model.search
        elif self._model.solves_matches and self._steps == 0:
            predict = self._follow
        found = [predict(queries.rows(rows[chunk]), templates_of(chunk)) for chunk in chunks]
        poses, scores = zip(*found, strict=True)
        return ViewPoses.cat(poses), torch.cat(scores).numpy()

    def _follow(self, queries: QueryTokens, templates: TemplateTokens) -> tuple[ViewPoses, Float[Tensor, "m"]]:
        initial = self._model.initial_poses(queries, templates, covered_only=True)
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
