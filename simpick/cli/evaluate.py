"""``simpick evaluate``: how good are estimated poses, on a BOP data set or on fresh simulated bins?"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from simpick.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console

    from simpick.assets.part import Part
    from simpick.pose_eval.pose_evaluation import PoseEvaluation
    from simpick.pose_eval.pose_images import PoseImage


@dataclass(frozen=True)
class Evaluate:
    """Run a pose estimator, or take a results file, and print BOP's average recalls per part and in all.

    Either on a BOP data set (`dataset`) or on fresh simulated bins (`scenes`).
    """

    estimator: str = "oracle"
    """Who estimates poses: oracle, another that ships, or one that a package registers."""
    dataset: Path | None = None
    """Folder of a BOP data set."""
    split: str | None = None
    """Data set: folder of scenes, such as test or val; by default test, or the only one."""
    camera: str | None = None
    """Data set: which sensor, where there are several, such as cam1."""
    models: str | None = None
    """Data set: folder of object models; by default models."""
    targets: str = "test_targets_bop19.json"
    """Data set: file that lists what is to be found, or "annotations" for all that is visible to a tenth."""
    detections: Path | None = None
    """Data set: detections in BOP's JSON format; by default the annotations' visible masks."""
    amodal: bool = False
    """Data set: the detections' boxes enclose whole objects, hidden parts included."""
    results: Path | None = None
    """Data set: score this results CSV instead of running an estimator."""
    results_out: Path | None = None
    """Data set: write the estimates as a results CSV, named METHOD_DATASET-SPLIT.csv for submission."""
    scenes: int = 0
    """How many fresh bins to evaluate on, each seen by the overhead camera."""
    seed: int = 0
    """Bins: seed of the first; bin k uses ``seed + k``."""
    parts: tuple[str, ...] = ()
    """Bins: part names or mesh files; one makes homogeneous bins, none means the whole library."""
    count: int = 12
    """Bins: how many parts each holds, 1 to 50."""
    noise: Literal["perfect", "realistic"] = "perfect"
    """Bins: how well parts are segmented before their poses are estimated."""
    randomization: str = "default"
    """Bins: preset of lights, colours, textures and camera jitter."""
    export: Path | None = None
    """Bins: write them as a BOP data set into this folder, with the detections beside them as JSON."""
    max_images: int | None = None
    """Data set: stop after this many images."""
    vsd: bool = True
    """VSD needs depth images and OpenGL; --no-vsd leaves it out, and with it AR, of which two terms remain."""

    def run(self) -> int:
        """Evaluate, print the tables, and write what was asked for."""
        self._check()
        return self._run_bins() if self.dataset is None else self._run_dataset(self.dataset)

    def _check(self) -> None:
        """Raise ConfigError for settings that do not go together, before anything is read or simulated."""
        if (self.dataset is None) == (self.scenes == 0):
            raise ConfigError("give either --dataset DIR or --scenes N: the images to evaluate on")
        if self.scenes < 0:
            raise ConfigError(f"scenes must be positive, got {self.scenes}")
        if self.max_images is not None and self.max_images < 1:
            raise ConfigError(f"max_images must be 1 or more, got {self.max_images}")
        given = {
            name: getattr(self, name) for name in ("detections", "results", "results_out", "split", "camera", "models")
        }
        if self.dataset is None and (foreign := [name for name, value in given.items() if value is not None]):
            raise ConfigError(f"{', '.join(foreign)} must come with --dataset, got --scenes {self.scenes}")
        if self.dataset is not None and self.export is not None:
            raise ConfigError("export must come with --scenes; a data set is one already")

    def _run_dataset(self, root: Path) -> int:
        from rich.console import Console

        from simpick.bop import BopDataset, BopResult, read_detections, read_results, write_results
        from simpick.pose_eval import bop_evaluation
        from simpick.pose_eval.pose_evaluation import PoseEvaluator
        from simpick.pose_eval.pose_runs import score_images
        from simpick.pose_eval.pose_sources import FileSource, make_source

        dataset = BopDataset(root, self.split, camera=self.camera, models=self.models)
        if self.targets == "annotations":
            targets = bop_evaluation.truth_targets(dataset)
        else:
            targets = list(dataset.targets(self.targets))
        keys = list(dict.fromkeys((t.scene_id, t.im_id) for t in targets))[: self.max_images]
        chosen = set(keys)
        targets = [t for t in targets if (t.scene_id, t.im_id) in chosen]
        detections = None if self.detections is None else read_detections(self.detections)

        def part_of(name: str) -> Part:
            return dataset.models.part(dataset.models.obj_id(name))

        if self.results is not None:
            method = self.results.stem
            source = FileSource(bop_evaluation.estimates_from_results(dataset, read_results(self.results), method))
        else:
            method, source = self.estimator, make_source(self.estimator, part_of)
        lines: list[BopResult] = []
        images = bop_evaluation.bop_images(dataset, targets, detections, amodal=self.amodal, depth=self.vsd)
        model_of, delta_m = partial(bop_evaluation.bop_pose_model, dataset), bop_evaluation.vsd_delta_m(dataset)
        console = Console()
        with PoseEvaluator(model_of, vsd=self.vsd, delta_m=delta_m) as evaluator:
            evaluation = score_images(
                images,
                source,
                evaluator,
                total=len(keys),
                on_image=lambda *answer: lines.extend(bop_evaluation.results_from_estimates(dataset, *answer)),
                console=console,
            )
        self._print(console, evaluation, f"{method} on {dataset.name}, {self.detections or 'true'} detections")
        if self.results_out is not None:
            write_results(self.results_out, lines)
            console.print(f"results: {self.results_out}")
        return 0

    def _run_bins(self) -> int:
        from rich.console import Console

        from simpick.assets.library import get_part, library_part_names
        from simpick.bop import BopWriter, write_detections
        from simpick.pose_eval.bin_images import bin_images, export_bin
        from simpick.pose_eval.pose_evaluation import PoseEvaluator
        from simpick.pose_eval.pose_images import PoseModel
        from simpick.pose_eval.pose_runs import score_images
        from simpick.pose_eval.pose_sources import make_source
        from simpick.scene import SceneConfig

        names = self.parts or tuple(library_part_names())
        # No arm: it stands at home, out of the overhead camera's sight.
        config = SceneConfig(parts=names, count=self.count, robot=None, randomization=self.randomization)
        parts = {part.name: part for part in map(get_part, names)}
        # Before any bin is simulated, so that a wrong name costs no time.
        source = make_source(self.estimator, parts.__getitem__)
        console = Console()
        with ExitStack() as stack:
            writer = None
            if self.export is not None:
                writer = stack.enter_context(BopWriter(self.export, list(parts.values())))

            found = []
            seeds = range(self.seed, self.seed + self.scenes)
            if writer is not None:
                writer.check_new(seeds)

            def images() -> Iterator[PoseImage]:
                for bin_image in bin_images(config, seeds, self.noise):
                    if writer is not None:
                        im_id = export_bin(writer, bin_image)
                        found.append((bin_image.image.scene_id, im_id, -1.0, bin_image.image.detections))
                    yield bin_image.image

            evaluator = stack.enter_context(PoseEvaluator(lambda name: PoseModel.of(parts[name]), vsd=self.vsd))
            evaluation = score_images(images(), source, evaluator, total=self.scenes, console=console)
        self._print(console, evaluation, f"{self.estimator} on {self.scenes} bins, {self.noise} detections")
        if writer is not None and self.export is not None:
            name = f"detections_{self.noise}_{seeds[0]}-{seeds[-1]}.json"
            write_detections(self.export / name, found, writer.obj_ids.__getitem__)
            console.print(f"data set: {self.export}")
        return 0

    @staticmethod
    def _print(console: Console, evaluation: PoseEvaluation, title: str) -> None:
        from simpick.pose_eval.pose_runs import recall_table, summary_table

        console.print(recall_table(evaluation, title))
        console.print(summary_table(evaluation))
        console.print(
            f"{evaluation.images} images, {evaluation.detections} detections, "
            f"{evaluation.ms_per_detection:.1f} ms a detection"
        )
