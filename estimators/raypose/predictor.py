"""`Predictor`: poses of queries relative to their templates, a few queries at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from simpick.estimators.raypose.diffusion.schedule import make_schedule
from simpick.estimators.raypose.network.consensus import consensus_pose, consensus_score
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.pose_solver import SolvedPoses
from simpick.estimators.raypose.network.tokens import QueryTokens, TemplateTokens
from simpick.estimators.raypose.sample_views import sample_views

_AT_ONCE = 32
"""Queries that are compared with their templates at a time: some 250 MB with `small`."""


class Predictor:
    """A network with its sampling schedule. The same queries give the same poses."""

    def __init__(self, model: RayPose, steps: int, seed: int) -> None:
        self._model, self._steps, self._seed = model, steps, seed
        self._schedule = make_schedule()

    def predict(
        self,
        queries: QueryTokens,
        rows: Int[np.ndarray, "n"],
        templates_of: Callable[[Int[np.ndarray, "m"]], TemplateTokens],
        *,
        denoise: bool,
    ) -> tuple[ViewPoses, Float[np.ndarray, "n"]]:
        """Return one pose for each of these rows of the queries, and its score in [0, 1].

        `templates_of` returns the templates of some of `rows`, by their positions in `rows`. Without `denoise`, poses
        are solved from matches alone, which ranks candidates well enough; networks that cannot do that denoise anyway.
        """
        chunks = np.split(np.arange(len(rows)), range(_AT_ONCE, len(rows), _AT_ONCE))
        predict = self._denoise if denoise or not self._model.solves_matches else self._model.search
        found = [predict(queries.rows(rows[chunk]), templates_of(chunk)) for chunk in chunks]
        poses, scores = zip(*found, strict=True)
        return ViewPoses.cat(poses), torch.cat(scores).numpy()

    def _denoise(self, queries: QueryTokens, templates: TemplateTokens) -> tuple[ViewPoses, Float[Tensor, "m"]]:
        fused = templates if templates.keys_values else self._model.fuse(templates)
        conditioning = self._model.condition(queries, fused)
        generator = torch.Generator().manual_seed(self._seed)
        views = sample_views(self._model, conditioning, self._schedule, self._steps, generator)
        pose = consensus_pose(views)
        if conditioning.initial is None or not self._model.solves_matches:
            return pose, consensus_score(views)
        solved = SolvedPoses.of(pose.map(lambda x: x[:, None]), templates.diameter_m[:, :1])
        return pose, conditioning.initial.support(queries, solved)[:, 0]
