"""``simpick evaluate``: the accuracy of estimated poses, on a BOP data set or on new simulated bins."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from simpick.cli.outputs import counted
from simpick.config import Config, NonNegativeInt, PositiveInt
from simpick.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simpick.assets.part import Part
    from simpick.bop import BopDataset, BopDetection
    from simpick.bop.scene_reader import BoxKind
    from simpick.estimators.base import Detector
    from simpick.pose_eval.pose_evaluation import PoseEvaluation
    from simpick.pose_eval.pose_images import PoseImage
    from simpick.pose_eval.pose_sources import Answer
    from simpick.terminal import Console

_ANNOTATED = ("perfect", "bbox_visib", "bbox_obj")
"""Detections that come from a data set's annotations."""
_OF_DATASET = ("results", "results_out", "split", "camera", "models", "max_images")


def _unless_given(metavar: str, default: str) -> object:
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {default})")


@dataclass(frozen=True)
class Evaluate(Config):
    """Score poses on a BOP data set or on new simulated bins.

    Prints BOP's average recalls, overall and per part, and medians by visibility. --dataset or --bins selects images.
    """

    estimator: str = "refined"
    """retrieval, coarse, fine, refined, retrieval_refined, another package's, or oracle; NAME@K: K hypotheses."""
    detections: str = "learned"
    """learned, another, FILE.json of BOP, perfect (upper bound); bins: realistic, box; data: bbox_visib, bbox_obj."""
    dataset: Annotated[Path | None, _unless_given("DIR", "simulated bins")] = None
    """Folder of a BOP data set."""
    split: Annotated[str | None, _unless_given("NAME", "test, or the only one")] = None
    """Data set: folder of scenes, such as test or val."""
    camera: Annotated[str | None, _unless_given("NAME", "the only one")] = None
    """Data set: sensor, where there are several, such as cam1."""
    models: Annotated[str | None, _unless_given("NAME", "models")] = None
    """Data set: folder of object models."""
    targets: str = "test_targets_bop19.json"
    """Data set: file of test targets, or "annotations" for all parts that are at least 10 % visible."""
    results: Annotated[Path | None, _unless_given("FILE", "an estimator is run")] = None
    """Data set: score this results CSV; needs neither detections nor masks."""
    results_out: Annotated[Path | None, _unless_given("FILE", "not written")] = None
    """Data set: results CSV to write, named METHOD_DATASET-SPLIT.csv for submission."""
    max_images: Annotated[PositiveInt | None, _unless_given("INT", "all")] = None
    """Data set: how many images to use, spread evenly over all."""
    bins: Annotated[NonNegativeInt, tyro.conf.arg(help_behavior_hint="(default: none, a data set)")] = 0
    """How many new bins to evaluate on, each seen by the overhead camera."""
    seed: NonNegativeInt = 0
    """Bins: seed of the first; bin k has seed + k."""
    parts: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="PART ...", help_behavior_hint="(default: the library)")
    ] = ()
    """Bins: part names or mesh files; a single one makes homogeneous bins."""
    count: int = 12
    """Bins: parts per bin, 1 to 50."""
    randomization: str = "default"
    """Bins: preset of lights, colours, textures and camera jitter."""
    export: Annotated[Path | None, _unless_given("DIR", "not written")] = None
    """Bins: folder to write them to as a BOP data set, with the detections as JSON."""
    vsd: Annotated[bool, tyro.conf.arg(help_behavior_hint="(default: with VSD)")] = True
    """Leave out VSD, which needs depth images and OpenGL, and with it AR."""

    def run(self) -> int:
        """Evaluate, print the tables, and write the files that were asked for."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        method = self.estimator if self.results is None else f"the results in {self.results}"
        images = counted(self.bins, "bin") if self.dataset is None else str(self.dataset)
        Console().print_line(f"evaluating {method} on {images}")
        return self._run_bins() if self.dataset is None else self._run_dataset(self.dataset)

    def _check_rules(self) -> None:
        """Raise ConfigError for settings that contradict each other, before anything is read or simulated."""
        if (self.dataset is None) == (self.bins == 0):
            raise ConfigError("give either --dataset DIR or --bins N: the images to evaluate on")
        given = [name for name in _OF_DATASET if getattr(self, name) is not None]
        if self.dataset is None and given:
            raise ConfigError(f"{', '.join(given)} must come with --dataset, got --bins {self.bins}")
        if self.dataset is not None and self.export is not None:
            raise ConfigError("export must come with --bins; a data set is one already")
        if self.dataset is None:
            from simpick.estimators.detections import detector_data

            detector_data(self.detections)
        if self.dataset is not None and self.detections in ("realistic", "box"):
            raise ConfigError(
                "detections of a data set must be perfect, bbox_visib, bbox_obj, a detector's name, or a JSON file in "
                "BOP's format, got "
                f"{self.detections!r}"
            )

    def _run_dataset(self, root: Path) -> int:
        from simpick.bop import BopDataset, BopResult, read_results, write_results
        from simpick.pose_eval import bop_evaluation
        from simpick.pose_eval.pose_evaluation import PoseEvaluator, score_images
        from simpick.pose_eval.pose_sources import FileSource, answers, make_source
        from simpick.terminal import Console, track

        console = Console()
        dataset = BopDataset(root, self.split, camera=self.camera, models=self.models)
        if self.targets == "annotations":
            targets = bop_evaluation.truth_targets(dataset)
        else:
            targets = list(dataset.targets(self.targets))
        targets = bop_evaluation.spread_images(targets, self.max_images)
        has_truth = all(dataset.scene(k).has_truth for k in {target.scene_id for target in targets})
        detections = self._detections_of(dataset, console, has_truth=has_truth)

        def part_of(name: str) -> Part:
            return dataset.models.part(dataset.models.obj_id(name))

        if self.results is not None:
            method, found = self.results.stem, read_results(self.results)
            results = bop_evaluation.known_results(dataset, found, self.results)
            if len(results) < len(found):
                console.print_line(
                    f"note: {len(found) - len(results)} of {len(found)} estimates are of scenes or images that the "
                    "split does not have"
                )
            if failed := sum(result.is_failed for result in results):
                console.print_line(f"note: {failed} of {len(results)} estimates failed (t = 0) and count as misses")
            source = FileSource(bop_evaluation.estimates_from_results(dataset, results, method))
        else:
            method, source = self.estimator, make_source(self.estimator, part_of)
        lines: list[BopResult] = []

        def keep(answer: Answer) -> None:
            lines.extend(bop_evaluation.results_from_answer(dataset, answer))

        images = bop_evaluation.bop_images(dataset, targets, detections, depth=self.vsd and has_truth)
        total = len({(target.scene_id, target.im_id) for target in targets})
        if has_truth:
            model_of, delta_m = partial(bop_evaluation.bop_pose_model, dataset), bop_evaluation.vsd_delta_m(dataset)
            with PoseEvaluator(model_of, vsd=self.vsd, delta_m=delta_m) as evaluator:
                evaluation = score_images(images, source, evaluator, total=total, on_answer=keep, console=console)
            of = "" if self.results is not None else f", {self.detections} detections"
            self._print(console, evaluation, f"{method} on {dataset.name}{of}")
        else:
            for answer in track(answers(images, source), "images", total=total, console=console):
                keep(answer)
            console.print_line(
                f"{len(lines)} estimates in {total} images; {dataset.name} has no true poses to compare with"
            )
        if self.results_out is not None:
            write_results(self.results_out, lines)
            console.print_line(f"results: {self.results_out}")
        return 0

    def _detections_of(
        self, dataset: BopDataset, console: Console, *, has_truth: bool
    ) -> list[BopDetection] | Detector | BoxKind | None:
        """Return what `bop_images` takes; raise ConfigError for what a data set without true poses cannot give."""
        from simpick.bop import read_detections
        from simpick.estimators.detections import is_file, photo_detector
        from simpick.pose_eval.bop_evaluation import known_detections

        if not has_truth and self.results is not None:
            raise ConfigError(
                f"{dataset.name} has no true poses (scene_gt.json) to score {self.results} with; choose a split "
                "that has them (--split), or submit the file where they are kept: for BOP's data sets, bop.felk.cvut.cz"
            )
        if not has_truth and self.results_out is None:
            raise ConfigError(
                f"{dataset.name} has no true poses (scene_gt.json) to score with; write estimates with --results-out "
                "METHOD_DATASET-SPLIT.csv"
            )
        if self.results is not None:
            return []
        if not has_truth and (self.detections in _ANNOTATED or self.estimator == "oracle"):
            raise ConfigError(
                f"{dataset.name} has no annotations (scene_gt.json), which perfect detections, boxes of annotations "
                "and the oracle need; give --detections FILE or learned, and an estimator"
            )
        if self.detections == "perfect":
            return None
        if self.detections == "bbox_visib" or self.detections == "bbox_obj":
            return self.detections
        if not is_file(self.detections):
            return photo_detector(self.detections, counted=True)
        found = read_detections(Path(self.detections))
        known = known_detections(dataset, found)
        if len(known) < len(found):
            console.print_line(f"note: {len(found) - len(known)} of {len(found)} detections are of unknown objects")
        return known

    def _run_bins(self) -> int:
        from simpick.assets import get_part, library_part_names
        from simpick.bop import BopWriter, write_detections
        from simpick.estimators.detections import is_file
        from simpick.pose_eval.bin_images import bin_images, export_bin
        from simpick.pose_eval.file_detections import check_covers, detections_of_bin
        from simpick.pose_eval.pose_evaluation import PoseEvaluator, score_images
        from simpick.pose_eval.pose_images import PoseModel
        from simpick.pose_eval.pose_sources import make_source
        from simpick.scene import SceneConfig
        from simpick.terminal import Console

        names = self.parts or tuple(library_part_names())
        # No arm: at its home pose it is outside the overhead camera's image.
        config = SceneConfig(parts=names, count=self.count, robot=None, randomization=self.randomization)
        parts = {part.name: part for part in map(get_part, names)}
        # Before any bin is simulated, so that a wrong name costs no time.
        source = make_source(self.estimator, parts.__getitem__)
        seeds = range(self.seed, self.seed + self.bins)
        detections = self.detections
        if is_file(self.detections):
            check_covers(Path(self.detections), seeds)
            detections = partial(detections_of_bin, Path(self.detections), part_names=tuple(parts))
        console = Console()
        with ExitStack() as stack:
            writer = None
            if self.export is not None:
                writer = stack.enter_context(BopWriter(self.export, list(parts.values())))

            found = []
            if writer is not None:
                writer.check_new(seeds)

            def images() -> Iterator[PoseImage]:
                for bin_image in bin_images(config, seeds, detections):
                    if writer is not None:
                        im_id = export_bin(writer, bin_image)
                        found.append((bin_image.image.scene_id, im_id, -1.0, bin_image.image.detections))
                    yield bin_image.image

            evaluator = stack.enter_context(PoseEvaluator(lambda name: PoseModel.of(parts[name]), vsd=self.vsd))
            evaluation = score_images(images(), source, evaluator, total=self.bins, console=console)
        self._print(console, evaluation, f"{self.estimator} on {self.bins} bins, {self.detections} detections")
        if writer is not None and self.export is not None:
            name = f"detections_{Path(self.detections).name.split('.')[0]}_{seeds[0]}-{seeds[-1]}.json"
            write_detections(self.export / name, found, writer.obj_ids.__getitem__)
            console.print_line(f"data set: {self.export}")
        return 0

    @staticmethod
    def _print(console: Console, evaluation: PoseEvaluation, title: str) -> None:
        from simpick.core_time import disturbance_lines
        from simpick.pose_eval.tables import recall_table, visibility_table

        console.print(recall_table(evaluation, title))
        console.print(visibility_table(evaluation, "medians and recalls", total=True))
        line = f"{evaluation.images} images"
        if evaluation.detections:  # A results file has none.
            line += f", {evaluation.detections} detections, {evaluation.ms_per_detection:.1f} ms per detection"
        console.print(line)
        for line in disturbance_lines({"estimates": evaluation.core_time}):
            console.print_line(line)
