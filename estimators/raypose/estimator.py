"""`RayPoseEstimator`: coarse and fine pose estimation with the ray-bundling diffusion network."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Int

from simpick.assets.part import Part
from simpick.errors import CheckpointError, ConfigError
from simpick.estimators.base import PoseEstimator
from simpick.estimators.floor import Floor
from simpick.estimators.pose_selection import distinct_poses
from simpick.estimators.raypose.candidates import Candidates
from simpick.estimators.raypose.checkpoints import load_checkpoint, shipped_checkpoint
from simpick.estimators.raypose.crops.query_crops import QueryCrops, crop_queries
from simpick.estimators.raypose.estimator_config import RayPoseEstimatorConfig
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.tokens import QueryTokens
from simpick.estimators.raypose.predictor import Predictor
from simpick.estimators.raypose.recent_views import RecentViews
from simpick.estimators.raypose.template_bank import (
    NOT_FOLLOWED,
    NOT_MATCHED,
    EncodedView,
    TemplateBank,
    ViewKey,
)
from simpick.estimators.raypose.view_index import ViewIndex, load_view_index
from simpick.estimators.valid_detections import check_onboarded, valid_detections
from simpick.geometry import transform
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis
from simpick.rendering import load_templates

_FINE_ITERATIONS, _COARSE_ITERATIONS = 1, 2


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
        """Take a network, and for fine the estimator that makes its first estimates; without one it is coarse.

        Any network can be coarse, also one that was trained with templates around a pose.

        Raises:
            ConfigError: a fine estimator is to make no iterations.
        """
        self.config = config or RayPoseEstimatorConfig()
        self.model, self.start = model.eval(), start
        self.mode = mode or ("coarse" if start is None else "fine")
        default = _COARSE_ITERATIONS if start is None else _FINE_ITERATIONS
        self._iterations = default if self.config.iterations is None else self.config.iterations
        if start is not None and self._iterations < 1:
            raise ConfigError(f"a fine network needs 1 iteration or more, got {self._iterations}")
        self._predictor = Predictor(self.model, self.config.decoder_steps, self.config.seed)
        self._banks: dict[str, TemplateBank] = {}
        self._recent = RecentViews[ViewKey, EncodedView]()
        self._indices: dict[str, ViewIndex] = {}

    def onboard(self, part: Part) -> None:
        """Render the part's templates, or take them from the cache; coarse templates are encoded at once."""
        if self.start is not None:
            self.start.onboard(part)
        known = self._banks.get(part.name)
        if known is None or known.part.content_hash != part.content_hash:
            templates = load_templates(part)
            bank = TemplateBank(self.model, part, templates, self._recent)
            if self.start is None:
                with torch.inference_mode():
                    bank.over_sphere()
            self._banks[part.name] = bank
            if self.start is not None and self.config.views:
                self._indices[part.name] = load_view_index(self.model, part, templates)

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return the pose of each valid detection, with its hypotheses.

        A detection has no estimate if its mask has fewer pixels than `min_mask_px` or its box is outside the image,
        or if the estimator that a fine one starts from has none.

        Raises:
            UnknownNameError: a detection's part has not been onboarded.
            ConfigError: a mask has another size than the image.
        """
        begin = time.perf_counter()
        check_onboarded(detections, self._banks)
        valid = valid_detections(detections, frame, self.config.min_mask_px)
        starts = self._starts(frame, [v.detection for v in valid])
        if starts is not None and not self.config.views:
            valid = [v for v in valid if id(v.detection) in starts]
        if not valid:
            return []
        turns = 1 if starts is not None else self.config.turns
        boxes = np.stack([v.box_xyxy_px for v in valid])
        crops = crop_queries(frame, [v.mask for v in valid], boxes, self.model.config, turns=turns)
        answers: dict[int, list[PoseHypothesis]] = {}
        with torch.inference_mode():
            queries = self.model.encode_query(crops.inputs)
            for part in dict.fromkeys(v.detection.part for v in valid):
                bank = self._banks[part]
                rows = np.array([i for i, v in enumerate(valid) if v.detection.part == part])
                if starts is None:
                    candidates = self._coarse(bank, crops, queries, rows)
                else:
                    own = [starts.get(id(valid[i].detection), []) for i in rows]
                    candidates = self._fine(bank, crops, queries, rows, own)
                answers.update((i, self._ranked(bank.part, candidates, i)) for i in rows.tolist())
        elapsed_s = (time.perf_counter() - begin) / len(valid)
        estimates = [
            PoseEstimate(part, best[0].T_camera_part, best[0].score, self.mode, elapsed_s, tuple(best), detection)
            for detection, part, best in ((v.detection, v.detection.part, answers[i]) for i, v in enumerate(valid))
        ]
        return Floor.under(frame, estimates, {name: bank.part for name, bank in self._banks.items()})

    def _starts(self, frame: CameraFrame, detections: Sequence[Detection]) -> dict[int, list[np.ndarray]] | None:
        """Return the first poses by the detection's identity; None for coarse, which needs none."""
        if self.start is None:
            return None
        starts = {}
        for estimate in self.start.estimate(frame, detections):
            own = estimate.hypotheses or (PoseHypothesis(estimate.T_camera_part, estimate.score),)
            starts[id(estimate.detection)] = [h.T_camera_part for h in own[: self.config.followed]]
        return starts

    def _fine(
        self,
        bank: TemplateBank,
        crops: QueryCrops,
        queries: QueryTokens,
        rows: Int[np.ndarray, "n"],
        starts: list[list[Float[np.ndarray, "4 4"]]],
    ) -> Candidates:
        """Return a candidate for each start, and for each of the views whose embeddings are most similar."""
        if self.config.views:
            index = self._indices[bank.part.name]
            half_tangents = crops.inputs.half_tangent[rows]
            found = index.search(self.model, bank.part, queries.embedding[rows], half_tangents, self.config.views)
            for own, row, (Ts_crop_part, _) in zip(starts, rows, found, strict=True):
                own += list(transform(crops.Rs_crop_camera[row].T) @ Ts_crop_part)
        rows = np.repeat(rows, [len(own) for own in starts])
        Ts_camera_part = np.stack([T for own in starts for T in own])
        candidates = Candidates(rows, rows, Ts_camera_part, np.zeros(len(rows)))
        kept = max(self.config.kept, self.config.hypotheses)
        if not self.model.solves_matches or max(map(len, starts)) <= kept:
            return self._iterate(bank, crops, queries, candidates)
        Ts_crop_part = crops.poses_in_crops(rows, candidates.Ts_camera_part)
        searched = self._predictor.search(
            queries, rows, lambda chunk: bank.around(Ts_crop_part[chunk], without=NOT_MATCHED)
        )
        best = replace(candidates, scores=searched.scores.numpy()).best_rows(kept)
        if self._iterations > 1 or not self._predictor.follows_matches:
            return self._iterate(bank, crops, queries, candidates.rows(best))
        rows, Ts_crop_part = rows[best], Ts_crop_part[best]
        pose, scores = self._predictor.follow(
            queries, rows, lambda chunk: bank.around(Ts_crop_part[chunk], without=NOT_FOLLOWED), searched.rows(best)
        )
        return Candidates(rows, rows, crops.poses_in_camera(rows, pose), scores)

    def _coarse(
        self, bank: TemplateBank, crops: QueryCrops, queries: QueryTokens, rows: Int[np.ndarray, "n"]
    ) -> Candidates:
        """Return the candidates that follow from the turns that match templates over the sphere best."""
        turns, sphere = self.config.turns, bank.over_sphere()

        def over_sphere(rows: Int[np.ndarray, "n"], *, final: bool) -> Candidates:
            pose, scores = self._predictor.predict(
                queries,
                rows,
                lambda chunk: sphere.for_queries(torch.zeros(len(chunk), dtype=torch.long)),
                final=final,
            )
            return Candidates(rows // turns, rows, crops.poses_in_camera(rows, pose), scores)

        turned = (rows[:, None] * turns + np.arange(turns)).ravel()
        first = over_sphere(turned, final=False).best(max(self.config.tried, self.config.hypotheses))
        if self._iterations == 0 and self.model.solves_matches:
            return over_sphere(first.crops, final=True)
        return self._iterate(bank, crops, queries, first)

    def _iterate(
        self, bank: TemplateBank, crops: QueryCrops, queries: QueryTokens, candidates: Candidates
    ) -> Candidates:
        """Return candidates after predictions from templates around them, repeated; only the last follow the flow, and
        are denoised if there are denoising steps.

        If a single hypothesis is asked for, the better half of what is tried is kept after the first pass.
        """
        tried, hypotheses = self.config.tried, self.config.hypotheses
        kept = max(tried, hypotheses) if hypotheses > 1 else (tried + 1) // 2
        for left in reversed(range(self._iterations)):
            Ts_camera_part, scores = self._predicted(bank, crops, queries, candidates, final=left == 0)
            candidates = replace(candidates, Ts_camera_part=Ts_camera_part, scores=scores)
            if left:
                candidates = candidates.best(kept)
        return candidates

    def _predicted(
        self, bank: TemplateBank, crops: QueryCrops, queries: QueryTokens, candidates: Candidates, *, final: bool
    ) -> tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n"]]:
        """Return the poses that follow from the templates around candidates, and their scores."""
        rows = candidates.crops
        Ts_crop_part = crops.poses_in_crops(rows, candidates.Ts_camera_part)
        pose, scores = self._predictor.predict(
            queries, rows, lambda chunk: bank.around(Ts_crop_part[chunk]), final=final
        )
        return crops.poses_in_camera(rows, pose), scores

    def _ranked(self, part: Part, candidates: Candidates, detection: int) -> list[PoseHypothesis]:
        """Return one detection's candidates without near-identical ones, best first."""
        own = candidates.rows(candidates.detections == detection)
        distinct = distinct_poses(
            own.Ts_camera_part,
            own.scores.astype(float),
            part.symmetries,
            part.diameter_m,
            rotation_deg=self.config.cluster_deg,
            translation_diameters=self.config.cluster_diameters,
            count=self.config.hypotheses,
        )
        return [PoseHypothesis(own.Ts_camera_part[k], float(own.scores[k])) for k in distinct]


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
        CheckpointError: there are no such weights, or fine is asked for and they are not of a fine network.
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

        start = RetrievalEstimator(RetrievalConfig(hypotheses=max(config.followed, 1)))
    return RayPoseEstimator(model, config, start=start)
