"""Scoring pose estimates image by image: BOP's average recalls, medians, and both by visibility."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError
from simpick.evaluation.matching import greedy_matches, top_estimates, valid_truths
from simpick.evaluation.pose_errors import mssd, pose_error
from simpick.evaluation.pose_images import PoseImage, PoseModel, PoseTruth
from simpick.evaluation.scores import DepthImages, PoseScores, TargetErrors, pose_scores, target_errors
from simpick.evaluation.summaries import VISIBILITY_BANDS, PoseSummary, summarize, summarize_by_visibility
from simpick.evaluation.visible_surface import VSD_DELTA_M
from simpick.geometry import Pinhole
from simpick.records import PoseError, PoseEstimate

if TYPE_CHECKING:
    from simpick.rendering import PartRenderer

_MAX_RENDERERS = 8
"""OpenGL contexts kept open at once: one a part and image size."""


@dataclass(frozen=True, eq=False)
class PoseEvaluation:
    """The outcome over all images."""

    scores: PoseScores
    """Average recalls, in all and per part."""
    summary: PoseSummary
    """Over all targets."""
    by_visibility: dict[str, PoseSummary]
    images: int
    detections: int
    estimation_s: float
    """Wall-clock time of all estimates."""

    @property
    def ms_per_detection(self) -> float:
        """Return the mean time of an estimate; NaN without detections."""
        return 1e3 * self.estimation_s / self.detections if self.detections else float("nan")


class PoseEvaluator:
    """Takes images with their estimates one by one and keeps only their errors. A context manager.

    With `vsd`, every image needs depth, and parts are rendered through OpenGL; without, AR stays None, since BOP's AR
    is the mean of three terms.
    """

    def __init__(self, model_of: Callable[[str], PoseModel], *, vsd: bool = True, delta_m: float = VSD_DELTA_M) -> None:
        self._model_of, self._vsd, self._delta_m = model_of, vsd, delta_m
        self._models: dict[str, PoseModel] = {}
        self._renderers: OrderedDict[tuple[str, int, int], PartRenderer] = OrderedDict()
        self._targets: list[TargetErrors] = []
        self._errors: list[PoseError | None] = []
        self._fractions: list[float] = []
        self._images = self._detections = 0
        self._estimation_s = 0.0

    def add(self, image: PoseImage, estimates: Sequence[PoseEstimate], elapsed_s: float) -> None:
        """Score one image's estimates, which took `elapsed_s` together.

        Raises:
            ConfigError: VSD is wanted and the image has no depth.
        """
        if self._vsd and image.frame.depth_m is None:
            raise ConfigError(
                f"VSD needs depth, and scene {image.scene_id}, image {image.im_id} has none; evaluate without VSD "
                "(--no-vsd)"
            )
        for part, inst_count in sorted(image.inst_counts.items()):
            self._add_target(image, part, inst_count, [e for e in estimates if e.part == part])
        self._images += 1
        self._detections += len(image.detections)
        self._estimation_s += elapsed_s

    def result(self) -> PoseEvaluation:
        """Return the scores of all images so far."""
        return PoseEvaluation(
            pose_scores(self._targets),
            summarize(self._errors),
            summarize_by_visibility(self._errors, np.array(self._fractions), VISIBILITY_BANDS),
            self._images,
            self._detections,
            self._estimation_s,
        )

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        while self._renderers:
            self._renderers.popitem()[1].close()

    def __enter__(self) -> PoseEvaluator:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _add_target(self, image: PoseImage, part: str, inst_count: int, estimates: list[PoseEstimate]) -> None:
        if part not in self._models:
            self._models[part] = self._model_of(part)
        model, camera = self._models[part], image.frame.camera
        truths = [truth for truth in image.truths if truth.part == part]
        fractions = np.array([truth.visible_fraction for truth in truths])
        scores = np.array([estimate.score for estimate in estimates])
        # What cannot count is dropped first, so that it is not rendered either.
        estimates = [estimates[k] for k in top_estimates(scores, inst_count)]
        truths = [truths[k] for k in valid_truths(fractions, inst_count)]
        Ts_estimate = np.array([e.T_camera_part for e in estimates]).reshape(-1, 4, 4)
        Ts_truth = np.array([t.T_camera_part for t in truths]).reshape(-1, 4, 4)
        depth = None
        if self._vsd and image.frame.depth_m is not None:
            rendered = [self._render(model, Ts, camera) for Ts in (Ts_estimate, Ts_truth)]
            depth = DepthImages(image.frame.depth_m, rendered[0], rendered[1], self._delta_m)
        scores, fractions = np.array([e.score for e in estimates]), np.array([t.visible_fraction for t in truths])
        self._targets.append(
            target_errors(model.evaluation, camera, Ts_estimate, scores, Ts_truth, fractions, inst_count, depth)
        )
        answers = _answers(model, estimates, truths, Ts_estimate, Ts_truth)
        self._errors += [
            None if T is None else pose_error(T, t.T_camera_part, model.evaluation)
            for T, t in zip(answers, truths, strict=True)
        ]
        self._fractions += [truth.visible_fraction for truth in truths]

    def _render(
        self, model: PoseModel, Ts_camera_part: Float[np.ndarray, "n 4 4"], camera: Pinhole
    ) -> Float[np.ndarray, "n height width"]:
        """Return depth of the part alone in each pose; nothing for poses behind the camera."""
        from simpick.rendering import PartRenderer

        depth_m = np.zeros((len(Ts_camera_part), camera.height, camera.width), np.float32)
        Ts_camera_rendered = Ts_camera_part @ model.T_part_rendered
        ahead = Ts_camera_rendered[:, 2, 3] > 0
        if ahead.any():
            key = model.rendered.name, camera.height, camera.width
            if key not in self._renderers:
                if len(self._renderers) >= _MAX_RENDERERS:
                    self._renderers.popitem(last=False)[1].close()
                self._renderers[key] = PartRenderer(model.rendered, camera.height, camera.width)
            self._renderers.move_to_end(key)
            depth_m[ahead] = self._renderers[key].render(Ts_camera_rendered[ahead], camera, rgb=False).depth_m
        return depth_m


def _answers(
    model: PoseModel,
    estimates: Sequence[PoseEstimate],
    truths: Sequence[PoseTruth],
    Ts_estimate: Float[np.ndarray, "e 4 4"],
    Ts_truth: Float[np.ndarray, "g 4 4"],
) -> list[Float[np.ndarray, "4 4"] | None]:
    """Return the pose that answers each truth.

    Where detections know the instance that they came from, that decides; else the surest estimates choose the nearest
    truth by MSSD, one each, however far off.
    """
    answers: list[Float[np.ndarray, "4 4"] | None] = [None] * len(truths)
    index = {truth.instance: k for k, truth in enumerate(truths)}
    known = [None if e.detection is None else e.detection.instance for e in estimates]
    if estimates and all(instance is not None for instance in known):
        for instance, T in zip(known, Ts_estimate, strict=True):
            if instance in index and answers[index[instance]] is None:
                answers[index[instance]] = T
    elif len(estimates) and len(truths):
        errors = mssd(Ts_estimate[:, None], Ts_truth[None], model.evaluation)
        for T, match in zip(Ts_estimate, greedy_matches(errors, np.array([np.inf]))[0], strict=True):
            if match >= 0:
                answers[match] = T
    return answers
