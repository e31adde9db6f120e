"""BOP data sets as `PoseImage`s with targets and detections, and conversion from and to results CSVs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from simpick.bop import BopDataset, BopDetection, BopResult, BopScene, BopTarget
from simpick.bop.detections_json import by_image
from simpick.bop.scene_reader import BoxKind
from simpick.bop.targets import MIN_VISIBLE_FRACTION
from simpick.errors import DatasetError
from simpick.estimators.base import Detector
from simpick.estimators.boundary import validated_detections
from simpick.estimators.detections import TRIED
from simpick.geometry import invert
from simpick.metrics.models import EvaluationModel
from simpick.metrics.visible_surface import VSD_DELTA_M
from simpick.pose_eval.pose_images import PoseImage, PoseModel, PoseTruth
from simpick.pose_eval.pose_sources import Answer
from simpick.records import CameraFrame, Detection, PoseEstimate

ITODD_DELTA_M = 0.005
"""Tolerance of VSD's visibility test on ITODD; the BOP toolkit uses 15 mm for all other data sets."""


def vsd_delta_m(dataset: BopDataset) -> float:
    """Return the tolerance of VSD's visibility test that BOP uses for a data set."""
    return ITODD_DELTA_M if dataset.name == "itodd" else VSD_DELTA_M


def bop_pose_model(dataset: BopDataset, part: str) -> PoseModel:
    """Return the eval model on which BOP measures a part's errors, with the diameter that the data set states."""
    models = dataset.models
    obj_id = models.obj_id(part)
    own, rendered = models.part(obj_id), models.eval_part(obj_id)
    evaluation = EvaluationModel(part, models.eval_points_m(obj_id), models.diameter_m(obj_id), own.symmetries)
    return PoseModel(evaluation, rendered, invert(own.T_cad_part) @ rendered.T_cad_part)


def bop_images(
    dataset: BopDataset,
    targets: Sequence[BopTarget],
    detections: Sequence[BopDetection] | Detector | BoxKind | None = None,
    *,
    depth: bool = True,
) -> Iterator[PoseImage]:
    """Yield the images that the targets name, in the targets' order.

    Per image and target object, the `detections` with the highest scores are used, as many as there are instances to
    find; of a detector's, 4 times as many, of whose poses the most certain count. If None, the annotations' visible
    masks are used, and a `BoxKind` stands for their boxes. Images of scenes without annotations have no truths.
    """
    wanted: dict[tuple[int, int], dict[str, int]] = {}
    for target in targets:
        if target.obj_id is None or target.inst_count is None:
            raise DatasetError(
                "these targets name images only; give a list with obj_id and inst_count, such as bop19's."
            )
        name = dataset.models.name(target.obj_id)
        wanted.setdefault((target.scene_id, target.im_id), {})[name] = target.inst_count
    found = by_image(detections if isinstance(detections, Sequence) and not isinstance(detections, str) else ())
    scene: BopScene | None = None
    for (scene_id, im_id), counts in wanted.items():
        if scene is None or scene.scene_id != scene_id:
            scene = dataset.scene(scene_id)
        frame = scene.frame(im_id, depth=depth)
        # Without scene_gt_info visibility is unknown: all instances count alike.
        truths = tuple(
            PoseTruth(t.part, t.T_camera_part, 1.0 if t.visible_fraction is None else t.visible_fraction, t.gt_id)
            for t in (scene.truth(im_id) if scene.has_truth else ())
        )
        if detections is None or isinstance(detections, str):
            own = scene.detections(im_id) if detections is None else scene.boxes(im_id, detections)
            chosen, seconds = [d for d in own if d.part in counts], 0.0
        elif isinstance(detections, Detector):
            start = time.perf_counter()
            parts = [dataset.models.part(dataset.models.obj_id(name)) for name in counts]
            seen = validated_detections(detections, frame, parts)
            seconds = time.perf_counter() - start
            chosen = [d for name, count in counts.items() for d in [d for d in seen if d.part == name][: TRIED * count]]
        else:
            entries = found.get((scene_id, im_id), [])
            chosen = _best(dataset, entries, counts, frame)
            seconds = max((entry.time_s for entry in entries), default=0.0)
        yield PoseImage(scene_id, im_id, frame, tuple(chosen), truths, counts, max(seconds, 0.0))


def truth_targets(dataset: BopDataset, min_visible_fraction: float = MIN_VISIBLE_FRACTION) -> list[BopTarget]:
    """Return all annotated instances of the split that are visible enough, as targets."""
    targets = []
    for scene in dataset:
        for im_id in scene:
            counts: dict[int, int] = {}
            for truth in scene.truth(im_id):
                if truth.visible_fraction is None or truth.visible_fraction >= min_visible_fraction:
                    counts[truth.obj_id] = counts.get(truth.obj_id, 0) + 1
            targets += [BopTarget(scene.scene_id, im_id, obj_id, count) for obj_id, count in sorted(counts.items())]
    return targets


def spread_images(targets: Sequence[BopTarget], count: int | None) -> list[BopTarget]:
    """Return the targets of `count` images, spread evenly over all; None stands for all."""
    keys = list(dict.fromkeys((t.scene_id, t.im_id) for t in targets))
    if count is None or count >= len(keys):
        return list(targets)
    chosen = {keys[round(k)] for k in np.linspace(0, len(keys) - 1, count)}
    return [t for t in targets if (t.scene_id, t.im_id) in chosen]


def known_detections(dataset: BopDataset, detections: Sequence[BopDetection]) -> list[BopDetection]:
    """Return the detections of objects that the data set has models of."""
    known = set(dataset.models.obj_ids)
    return [detection for detection in detections if detection.obj_id in known]


def known_results(dataset: BopDataset, results: Sequence[BopResult], path: Path) -> list[BopResult]:
    """Return the results of images that the split has; `path` names their file in errors.

    Raises `DatasetError` if there are none among them.
    """
    scenes = {result.scene_id for result in results} & set(dataset.scene_ids)
    images = {(scene_id, im_id) for scene_id in scenes for im_id in dataset.scene(scene_id).im_ids}
    known = [result for result in results if (result.scene_id, result.im_id) in images]
    if results and not known:
        raise DatasetError(
            f"{path}: has no line of an image of {dataset.root / dataset.split}. It begins with scene "
            f"{results[0].scene_id}, image {results[0].im_id}; scenes there: "
            f"{', '.join(map(str, dataset.scene_ids[:10]))}. Choose the split of these results."
        )
    return known


def estimates_from_results(
    dataset: BopDataset, results: Sequence[BopResult], method: str
) -> dict[tuple[int, int], list[PoseEstimate]]:
    """Return the estimates of a results CSV by scene and image, in the file's order, without the failed ones."""
    estimates: dict[tuple[int, int], list[PoseEstimate]] = {}
    for r in results:
        if r.is_failed:
            continue
        part = dataset.models.part(r.obj_id)
        estimate = PoseEstimate(part.name, r.T_camera_model @ part.T_cad_part, r.score, method, max(r.time_s, 0.0))
        estimates.setdefault((r.scene_id, r.im_id), []).append(estimate)
    return estimates


def results_from_answer(dataset: BopDataset, answer: Answer) -> list[BopResult]:
    """Return the lines of a results CSV for one image; its time is that of detection and estimation together."""
    image, time_s = answer.image, answer.image.detection_s + answer.estimation_s
    results = []
    for estimate in answer.estimates:
        obj_id = dataset.models.obj_id(estimate.part)
        T_camera_model = estimate.T_camera_part @ invert(dataset.models.part(obj_id).T_cad_part)
        results.append(BopResult(image.scene_id, image.im_id, obj_id, estimate.score, T_camera_model, time_s))
    return results


def _best(
    dataset: BopDataset, entries: Sequence[BopDetection], counts: dict[str, int], frame: CameraFrame
) -> list[Detection]:
    """Return the detections of each target part with the highest scores, as many as there are instances to find."""
    height, width = frame.rgb.shape[:2]
    left = dict(counts)
    chosen = []
    for entry in sorted(entries, key=lambda e: -e.score):
        name = dataset.models.name(entry.obj_id)
        if left.get(name, 0) > 0:
            left[name] -= 1
            chosen.append(entry.detection(name, height, width))
    return chosen
