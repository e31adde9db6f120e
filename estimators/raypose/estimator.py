"""`RayPoseEstimator`: coarse and fine pose estimation with the ray-bundling diffusion network."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.answerable import answerable
from simpick.estimators.base import PoseEstimator
from simpick.estimators.pose_clusters import cluster_hypotheses
from simpick.estimators.raypose.checkpoints import load_checkpoint, shipped_checkpoint
from simpick.estimators.raypose.inference import combine_views, disagreement_rad, sample_views
from simpick.estimators.raypose.model import QueryInputs, QueryTokens, RayPose, TemplateTokens
from simpick.estimators.raypose.pose_maps import ViewPoses
from simpick.estimators.raypose.schedule import make_schedule
from simpick.estimators.raypose.template_bank import TemplateBank
from simpick.geometry import VirtualCameras, crop_images, transform
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis
from simpick.rendering import load_templates

_DISAGREEMENT_RAD = np.radians(20.0)
"""Disagreement of the templates at which a score falls to 1/e."""


@dataclass(frozen=True)
class RayPoseEstimatorConfig:
    """How the network is used."""

    iterations: int = 1
    """Fine only: how often templates are drawn around the estimate and a new one made."""
    steps: int = 3
    """Denoising steps."""
    hypotheses: int = 1
    """Poses for each detection, best first; a fine predictor begins at as many of its start's hypotheses."""
    min_mask_px: int = 16
    """Detections with fewer pixels are not answered."""
    seed: int = 0
    """Of the noise that denoising begins with."""
    cluster_deg: float = 5.0
    """Hypotheses closer than this, and than `cluster_diameters`, are one."""
    cluster_diameters: float = 0.1
    """Of the part: how close hypotheses are that are one."""

    def __post_init__(self) -> None:
        for name in ("iterations", "steps", "hypotheses", "min_mask_px"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} must be 1 or more, got {getattr(self, name)}")
        if self.hypotheses > 64:
            raise ConfigError(f"hypotheses must be between 1 and 64, got {self.hypotheses}")


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
        """Take a network, and for a fine one the estimator that gives its first estimates.

        Raises:
            ConfigError: a fine network has no start, or a coarse one has.
        """
        self.config = config or RayPoseEstimatorConfig()
        self.model, self.start = model.eval(), start
        if model.config.is_fine and start is None:
            raise ConfigError(
                "a fine network refines: give it an estimator to start from, such as RetrievalEstimator()"
            )
        self.mode = mode or ("fine" if model.config.is_fine else "coarse")
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
        found = answerable(detections, frame, self.config.min_mask_px)
        starts = self._starts(frame, [d for d, _, _ in found])
        if starts is not None:
            found = [f for f in found if id(f[0]) in starts]
        if not found:
            return []
        kept, masks, boxes = (list(column) for column in zip(*found, strict=True))
        network = self.model.config
        crops = crop_images(
            frame.rgb, frame.camera, np.stack(boxes), network.crop_px, masks=masks, padding=network.padding
        )
        assert crops.masks is not None
        half_tangent = crops.cameras.size_px / 2 / crops.cameras.focal_px
        answers: dict[int, list[PoseHypothesis]] = {}
        with torch.inference_mode():
            queries = self.model.encode_query(
                QueryInputs(
                    torch.from_numpy(crops.rgb).permute(0, 3, 1, 2).float() / 255,
                    torch.from_numpy(crops.masks).float(),
                    torch.tensor(half_tangent, dtype=torch.float32),
                )
            )
            for part in dict.fromkeys(d.part for d in kept):
                rows = [i for i, d in enumerate(kept) if d.part == part]
                chosen = None if starts is None else [starts[id(kept[i])] for i in rows]
                answers.update(zip(rows, self._answer(part, queries, rows, crops.cameras, chosen), strict=True))
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

    def _answer(
        self,
        part: str,
        queries: QueryTokens,
        rows: list[int],
        cameras: VirtualCameras,
        starts: list[list[np.ndarray]] | None,
    ) -> list[list[PoseHypothesis]]:
        """Return the hypotheses of these detections of one part, best first."""
        bank = self._banks[part][1]
        if starts is None:
            query = np.array(rows)
            views, likeness = self._sample(queries, query, _repeated(bank.over_sphere(), len(rows)))
        else:
            query = np.repeat(rows, [len(own) for own in starts])
            Ts = cameras.Ts_crop_camera[query] @ np.stack([T for own in starts for T in own])
            for _ in range(self.config.iterations):
                views, likeness = self._sample(queries, query, bank.around(Ts))
                Ts = _poses(combine_views(views), cameras, query)
        pose = combine_views(views)
        score = (likeness * torch.exp(-disagreement_rad(views, pose) / _DISAGREEMENT_RAD)).numpy()
        if starts is None and self.config.hypotheses > 1:
            # Every template's own answer is a hypothesis beside the mean of all, which stays the best.
            count = views.reach_m.shape[1]
            Ts = np.concatenate([_poses(pose, cameras, query)[:, None], _each(views, cameras, query)], axis=1)
            scores = np.concatenate([score[:, None], np.tile(0.99 * score[:, None], (1, count))], axis=1)
            pairs = [list(zip(own, values, strict=True)) for own, values in zip(Ts, scores, strict=True)]
        else:
            Ts = _poses(pose, cameras, query)
            pairs = [[(Ts[k], score[k]) for k in np.flatnonzero(query == row)] for row in rows]
        return [self._ranked(part, own, cameras, row) for own, row in zip(pairs, rows, strict=True)]

    def _sample(
        self, queries: QueryTokens, query: np.ndarray, templates: TemplateTokens
    ) -> tuple[ViewPoses, Float[torch.Tensor, "n"]]:
        own = QueryTokens(*(getattr(queries, field.name)[query] for field in dataclasses.fields(queries)))
        conditioning = self.model.condition(own, templates)
        generator = torch.Generator().manual_seed(self.config.seed)
        views = sample_views(self.model, conditioning, self._schedule, self.config.steps, generator)
        if conditioning.matches is None:
            return views, torch.ones(len(query))
        matched = conditioning.matches.likeness.unflatten(0, (len(query), -1)).mean(dim=1)
        weight = own.coverage / own.coverage.sum(dim=1, keepdim=True).clamp_min(1e-6)
        return views, (matched * weight).sum(dim=1).clamp(0, 1)

    def _ranked(
        self, part: str, pairs: list[tuple[np.ndarray, float]], cameras: VirtualCameras, row: int
    ) -> list[PoseHypothesis]:
        T_camera_crop = transform(cameras.Rs_crop_camera[row].T)
        hypotheses = [PoseHypothesis(T_camera_crop @ T, float(score)) for T, score in pairs]
        clusters = cluster_hypotheses(
            hypotheses,
            self._parts[part].symmetries,
            self._parts[part].diameter_m,
            rotation_deg=self.config.cluster_deg,
            translation_diameters=self.config.cluster_diameters,
        )
        return [cluster.best for cluster in clusters][: self.config.hypotheses]


def load_estimator(
    mode: Literal["coarse", "fine"],
    config: RayPoseEstimatorConfig | None = None,
    *,
    weights: Path | None = None,
    start: PoseEstimator | None = None,
) -> RayPoseEstimator:
    """Return the estimator of a mode, with its shipped weights or with those of a file.

    `fine` starts from `start`, or from retrieval: see the weights' card for why.

    Raises:
        CheckpointError: there are no such weights, or they are not of this mode.
    """
    from simpick.errors import CheckpointError

    path = weights or shipped_checkpoint(mode)
    model = load_checkpoint(path).model
    if model.config.is_fine != (mode == "fine"):
        raise CheckpointError(
            f"{path} must hold a {mode} network, got one with templates within {model.config.spread_deg:g} degrees"
        )
    config = config or RayPoseEstimatorConfig()
    if mode == "fine" and start is None:
        from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator

        start = RetrievalEstimator(RetrievalConfig(hypotheses=max(5, config.hypotheses)))
    return RayPoseEstimator(model, config, start=start)


def _poses(pose: ViewPoses, cameras: VirtualCameras, query: np.ndarray) -> Float[np.ndarray, "n 4 4"]:
    """Return T_crop_part in the virtual cameras of these detections."""
    half_tangent = torch.tensor(cameras.size_px / 2 / cameras.focal_px[query], dtype=torch.float64)
    exact = ViewPoses(pose.R.double(), pose.centre.double(), pose.reach_m.double())
    return exact.pose(half_tangent).numpy()


def _each(views: ViewPoses, cameras: VirtualCameras, query: np.ndarray) -> Float[np.ndarray, "n views 4 4"]:
    count = views.reach_m.shape[1]
    flat = ViewPoses(views.R.flatten(0, 1), views.centre.flatten(0, 1), views.reach_m.flatten())
    return _poses(flat, cameras, np.repeat(query, count)).reshape(len(query), count, 4, 4)


def _repeated(templates: TemplateTokens, count: int) -> TemplateTokens:
    """Return one set of templates for each of `count` queries, without copying."""

    def expand(x: torch.Tensor) -> torch.Tensor:
        return x.expand(count, *x.shape[1:])

    poses = ViewPoses(*(expand(x) for x in (templates.poses.R, templates.poses.centre, templates.poses.reach_m)))
    tensors = {
        name: expand(getattr(templates, name)) for name in ("tokens", "descriptors", "points", "coverage", "diameter_m")
    }
    return dataclasses.replace(templates, poses=poses, **tensors)
