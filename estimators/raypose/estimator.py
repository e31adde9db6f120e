"""`RayPoseEstimator`: coarse and fine pose estimation with the ray-bundling diffusion network."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
from annotated_types import Interval
from jaxtyping import Float, Int

from simpick.assets.part import Part
from simpick.config import Config, NonNegativeInt, PositiveInt
from simpick.errors import CheckpointError, ConfigError, UnknownNameError
from simpick.estimators.base import PoseEstimator
from simpick.estimators.pose_clusters import cluster_hypotheses
from simpick.estimators.raypose.checkpoints import load_checkpoint, shipped_checkpoint
from simpick.estimators.raypose.crops.query_crops import QueryCrops, crop_queries
from simpick.estimators.raypose.diffusion.schedule import make_schedule
from simpick.estimators.raypose.network.consensus import agreement, combine_views
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import QueryTokens, TemplateTokens, map_tensors
from simpick.estimators.raypose.sample_views import sample_views
from simpick.estimators.raypose.template_bank import TemplateBank
from simpick.estimators.valid_detections import valid_detections
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis
from simpick.rendering import load_templates

_AT_ONCE = 32
"""Queries that are compared with their templates at a time: some 250 MB with `small`."""
_FINE_ITERATIONS, _COARSE_ITERATIONS = 1, 2


@dataclass(frozen=True)
class RayPoseEstimatorConfig(Config):
    """How the network is used."""

    turns: PositiveInt = 12
    """Coarse only: turns of a detection about the optical axis in which it is compared with the upright templates."""
    tried: PositiveInt = 8
    """Coarse only: how many of the turns, those whose matches agree best on a pose, are followed; where one hypothesis
    is asked for, the better half of them after the first pass."""
    iterations: NonNegativeInt | None = None
    """How often templates are taken around the estimate and a new one made: 1 if None for fine; for coarse 2, beside
    the first estimate from templates over the sphere."""
    steps: PositiveInt = 3
    """Denoising steps."""
    hypotheses: Annotated[int, Interval(ge=1, le=64)] = 1
    """Poses for each detection, best first; a fine predictor begins at as many of its start's hypotheses."""
    min_mask_px: PositiveInt = 16
    """Detections with fewer pixels are not answered."""
    seed: int = 0
    """Of the noise that denoising begins with."""
    cluster_deg: float = 5.0
    """Hypotheses closer than this, and than `cluster_diameters`, are one."""
    cluster_diameters: float = 0.1
    """Of the part: how close hypotheses are that are one."""


class RayPoseEstimator:
    """Poses relative to templates: over the whole sphere (coarse) or around a first estimate (fine).

    Implements `PoseEstimator`. All detections of a part go through the network in one batch; the same image gives the
    same answer.
    """

    def __init__(
        self,
        model: RayPose,
        config: RayPoseEstimatorConfig | None = None,
        *,
        start: PoseEstimator | None = None,
        mode: str | None = None,
    ) -> None:
        """Take a network, and to be fine the estimator that gives its first estimates; without one it is coarse.

        Any network can be coarse, also one that was trained with templates around a pose.

        Raises:
            ConfigError: a fine estimator is to make no iterations.
        """
        self.config = config or RayPoseEstimatorConfig()
        self.model, self.start = model.eval(), start
        self.mode = mode or ("coarse" if start is None else "fine")
        asked = self.config.iterations
        self._iterations = (_COARSE_ITERATIONS if start is None else _FINE_ITERATIONS) if asked is None else asked
        if start is not None and self._iterations < 1:
            raise ConfigError(f"a fine network needs 1 iteration or more, got {self._iterations}")
        self._schedule = make_schedule()
        self._banks: dict[str, tuple[str, TemplateBank]] = {}
        self._parts: dict[str, Part] = {}

    def onboard(self, part: Part) -> None:
        """Render the part's templates, or take them from the cache; coarse templates are encoded at once."""
        if self.start is not None:
            self.start.onboard(part)
        known = self._banks.get(part.name)
        if known is None or known[0] != part.content_hash:
            bank = TemplateBank(self.model, part, load_templates(part))
            if self.start is None:
                with torch.inference_mode():
                    bank.over_sphere()
            self._banks[part.name] = (part.content_hash, bank)
            self._parts[part.name] = part

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return the pose of each detection that can be answered, with its hypotheses.

        A detection has no estimate if its mask has fewer pixels than `min_mask_px` or its box is outside the image,
        or if the estimator that a fine one starts from has none.

        Raises:
            UnknownNameError: a detection's part has not been onboarded.
            ConfigError: a mask has another size than the image.
        """
        begin = time.perf_counter()
        for detection in detections:
            if detection.part not in self._banks:
                raise UnknownNameError(
                    "onboarded part", detection.part, self._banks, "Call onboard(part) before estimate()."
                )
        found = valid_detections(detections, frame, self.config.min_mask_px)
        starts = self._starts(frame, [d for d, _, _ in found])
        if starts is not None:
            found = [f for f in found if id(f[0]) in starts]
        if not found:
            return []
        kept, masks, boxes = (list(column) for column in zip(*found, strict=True))
        turns = 1 if starts is not None else self.config.turns
        crops = crop_queries(frame, masks, np.stack(boxes), self.model.config, turns=turns)
        answers: dict[int, list[PoseHypothesis]] = {}
        with torch.inference_mode():
            queries = self.model.encode_query(crops.inputs)
            for part in dict.fromkeys(d.part for d in kept):
                rows = [i for i, d in enumerate(kept) if d.part == part]
                if starts is None:
                    guesses = self._coarse(part, crops, queries, rows, turns)
                else:
                    guesses = self._fine(part, crops, queries, rows, [starts[id(kept[i])] for i in rows])
                answers.update((i, self._ranked(part, guesses, i)) for i in rows)
        elapsed_s = (time.perf_counter() - begin) / len(kept)
        return [
            PoseEstimate(d.part, best[0].T_camera_part, best[0].score, self.mode, elapsed_s, tuple(best), detection=d)
            for d, best in ((d, answers[i]) for i, d in enumerate(kept))
        ]

    def _starts(self, frame: CameraFrame, detections: Sequence[Detection]) -> dict[int, list[np.ndarray]] | None:
        """Return the first poses by the detection's identity; None for coarse, which needs none."""
        if self.start is None:
            return None
        starts = {}
        for estimate in self.start.estimate(frame, detections):
            own = estimate.hypotheses or (PoseHypothesis(estimate.T_camera_part, estimate.score),)
            starts[id(estimate.detection)] = [h.T_camera_part for h in own[: self.config.hypotheses]]
        return starts

    def _fine(
        self, part: str, crops: QueryCrops, queries: QueryTokens, rows: list[int], starts: list[list[np.ndarray]]
    ) -> _Guesses:
        """Return a guess for each start."""
        query = np.repeat(rows, [len(own) for own in starts])
        Ts_camera_part = np.stack([T for own in starts for T in own])
        return self._followed(part, crops, queries, _Guesses(query, query, Ts_camera_part, np.zeros(len(query))))

    def _coarse(self, part: str, crops: QueryCrops, queries: QueryTokens, rows: list[int], turns: int) -> _Guesses:
        """Return the guesses that the most promising turns lead to."""
        turned = (np.array(rows)[:, None] * turns + np.arange(turns)).ravel()
        sphere = self._banks[part][1].over_sphere()

        def guessed(rows: np.ndarray, is_last: bool) -> _Guesses:
            pose, scores = self._answer(queries, rows, lambda few: _for_all(sphere, few), is_last=is_last)
            return _Guesses(rows // turns, rows, crops.poses_in_camera(rows, pose), scores)

        first = guessed(turned, is_last=False).best(max(self.config.tried, self.config.hypotheses))
        if self._iterations == 0 and self.model.matches:
            return guessed(first.crops, is_last=True)
        return self._followed(part, crops, queries, first)

    def _followed(self, part: str, crops: QueryCrops, queries: QueryTokens, guesses: _Guesses) -> _Guesses:
        """Return guesses after templates around them, an answer, templates around that, and so on.

        If only one is asked for, the better half of what is tried goes on after the first pass.
        """
        bank, hypotheses = self._banks[part][1], self.config.hypotheses
        kept = max(self.config.tried, hypotheses) if hypotheses > 1 else (self.config.tried + 1) // 2
        for left in reversed(range(self._iterations)):
            Ts_crop_part = crops.poses_in_crops(guesses.crops, guesses.Ts_camera_part)
            pose, scores = self._answer(
                queries, guesses.crops, lambda few, Ts=Ts_crop_part: bank.around(Ts[few]), is_last=left == 0
            )
            Ts_camera_part = crops.poses_in_camera(guesses.crops, pose)
            guesses = _Guesses(guesses.rows, guesses.crops, Ts_camera_part, scores)
            if left:
                guesses = guesses.best(kept)
        return guesses

    def _answer(
        self,
        queries: QueryTokens,
        rows: Int[np.ndarray, "n"],
        templates_of: Callable[[np.ndarray], TemplateTokens],
        *,
        is_last: bool,
    ) -> tuple[ViewPoses, Float[np.ndarray, "n"]]:
        """Return the templates' common answer for these queries, and its score, in [0, 1].

        A few at a time, so that comparing many takes no more memory than a few; `templates_of` gives those of some
        rows, by their places among `rows`.
        """
        places = np.split(np.arange(len(rows)), range(_AT_ONCE, len(rows), _AT_ONCE))
        answers = [self._answer_few(_some(queries, rows[few]), templates_of(few), is_last=is_last) for few in places]
        poses, scores = zip(*answers, strict=True)
        R, centre, half_extent_at_depth_m = (
            torch.cat([getattr(pose, f) for pose in poses]) for f in ("R", "centre", "half_extent_at_depth_m")
        )
        return ViewPoses(R, centre, half_extent_at_depth_m), np.concatenate(scores)

    def _answer_few(
        self, own: QueryTokens, templates: TemplateTokens, *, is_last: bool
    ) -> tuple[ViewPoses, Float[np.ndarray, "n"]]:
        # Before the last pass, poses solved from matches are good enough to choose templates by.
        if self.model.matches and not is_last:
            pose, scores = self.model.search(own, templates)
            return pose, scores.numpy()
        conditioning = self.model.condition(own, templates if templates.kv else self.model.fuse(templates))
        generator = torch.Generator().manual_seed(self.config.seed)
        views = sample_views(self.model, conditioning, self._schedule, self.config.steps, generator)
        pose = combine_views(views)
        if conditioning.matched is None or not self.model.matches:
            # Without matches, templates' agreement is all there is to go by.
            return pose, agreement(views).numpy()
        single = map_tensors(pose, lambda x: x[:, None])
        return pose, self.model.support(own, conditioning.matched.matches, single, templates.diameter_m)[:, 0].numpy()

    def _ranked(self, part: str, guesses: _Guesses, row: int) -> list[PoseHypothesis]:
        """Return one detection's guesses without near-identical ones, best first."""
        clusters = cluster_hypotheses(
            [
                PoseHypothesis(guesses.Ts_camera_part[k], float(guesses.scores[k]))
                for k in np.flatnonzero(guesses.rows == row)
            ],
            self._parts[part].symmetries,
            self._parts[part].diameter_m,
            rotation_deg=self.config.cluster_deg,
            translation_diameters=self.config.cluster_diameters,
        )
        return [cluster.best for cluster in clusters][: self.config.hypotheses]


@dataclass(frozen=True, eq=False)
class _Guesses:
    """Poses of detections, any number each."""

    rows: Int[np.ndarray, "n"]
    """Detections."""
    crops: Int[np.ndarray, "n"]
    """Crops of theirs that they are seen in: one of several turns."""
    Ts_camera_part: Float[np.ndarray, "n 4 4"]
    scores: Float[np.ndarray, "n"]

    def best(self, count: int) -> _Guesses:
        """Return the `count` guesses of each detection with the highest scores."""
        order = np.lexsort((-self.scores, self.rows))
        rows = self.rows[order]
        kept = order[np.arange(len(rows)) - np.searchsorted(rows, rows) < count]
        return _Guesses(self.rows[kept], self.crops[kept], self.Ts_camera_part[kept], self.scores[kept])


def load_raypose(
    mode: Literal["coarse", "fine"],
    config: RayPoseEstimatorConfig | None = None,
    *,
    weights: Path | None = None,
    start: PoseEstimator | None = None,
) -> RayPoseEstimator:
    """Return RayPose in one of its modes, with the shipped weights or with those of a file.

    `fine` starts from `start`, or from retrieval: see the weights' card for why. `coarse` takes the weights of either.

    Raises:
        CheckpointError: there are no such weights, or fine ones are wanted and they are not.
    """
    path = weights or shipped_checkpoint()
    model = load_checkpoint(path).model
    if mode == "fine" and not model.config.is_fine:
        raise CheckpointError(
            f"{path} must hold a fine network, got one with templates within {model.config.spread_deg:g} degrees"
        )
    config = config or RayPoseEstimatorConfig()
    if mode == "fine" and start is None:
        from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator

        start = RetrievalEstimator(RetrievalConfig(hypotheses=max(5, config.hypotheses)))
    return RayPoseEstimator(model, config, start=start)


def _for_all(templates: TemplateTokens, places: np.ndarray) -> TemplateTokens:
    """Return one set of templates for each of so many queries."""
    return templates.for_queries(torch.zeros(len(places), dtype=torch.long))


def _some(queries: QueryTokens, rows: np.ndarray) -> QueryTokens:
    return QueryTokens(*(getattr(queries, field.name)[torch.from_numpy(rows)] for field in dataclasses.fields(queries)))
