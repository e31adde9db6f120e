"""The pose benchmark: estimators scored on the fixed bins, one after the other or in several processes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

from simpick.assets.library import get_part
from simpick.bop import BopWriter
from simpick.closing import Closing
from simpick.errors import ConfigError
from simpick.estimators.detections import is_file
from simpick.estimators.registry import PoseBudget
from simpick.metrics.scores import average_recalls
from simpick.metrics.summaries import PoseSummary
from simpick.pose_eval.benchmark_bins import (
    MIXED_PARTS,
    BenchmarkBin,
    Look,
    benchmark_bins,
    fingerprint,
    fresh_view,
    load_view,
    view_path,
)
from simpick.pose_eval.best_of import best_of
from simpick.pose_eval.bin_images import BinImage, BinView, export_bin
from simpick.pose_eval.file_detections import detections_of_bin
from simpick.pose_eval.pose_evaluation import (
    ImageErrors,
    InstanceError,
    PoseEvaluation,
    PoseEvaluator,
    summarize_instances,
)
from simpick.pose_eval.pose_images import PoseImage, library_model
from simpick.pose_eval.pose_sources import PoseSource, answers, make_source
from simpick.terminal import Console, track
from simpick.workers import UNLIMITED, WorkerPool

BEST_OF = (1, 5, 50)
"""Numbers of hypotheses whose best is reported, besides the number that the estimator makes."""

_Result = TypeVar("_Result")


@dataclass(frozen=True, eq=False)
class BinScore:
    """The scores of one estimator on one bin."""

    fingerprint: str
    """Of the bin's view."""
    errors: dict[str, ImageErrors]
    """By detection preset."""
    best_of: dict[tuple[str, int | None], tuple[InstanceError, ...]]
    """By detection preset and number of hypotheses; None for all hypotheses of each estimate."""
    hypotheses: int
    """Largest number of hypotheses of one estimate."""
    onboarding_s: dict[str, float]
    """Time to onboard each part that was new to this process."""


@dataclass(frozen=True)
class BinFigures:
    """The figures of one bin; their mean over bins, weighted by targets, is the figure over all bins."""

    targets: int
    ar: float
    """Average recall, in [0, 1]; 0 for a bin without targets."""
    below_5_deg: float
    """Fraction of targets with a rotation error below 5 degrees."""

    @staticmethod
    def of(errors: ImageErrors) -> BinFigures:
        """Return the figures of one bin's image."""
        scores = average_recalls(errors.targets)
        return BinFigures(scores.targets, scores.ar or 0.0, summarize_instances(errors.instances).recall_5_deg)


@dataclass(frozen=True, eq=False)
class PoseBenchmarkResult:
    """The scores of one estimator on all bins."""

    estimator: str
    bins: tuple[BenchmarkBin, ...]
    fingerprint: str
    """Of all views."""
    evaluations: dict[str, PoseEvaluation]
    """By detection preset."""
    by_bin: dict[str, tuple[BinFigures, ...]]
    """By detection preset, in the order of `bins`: the basis of paired differences between estimators."""
    best_of: dict[tuple[str, int], PoseSummary]
    """By detection preset and number of hypotheses: the numbers in `BEST_OF` up to `hypotheses`, and `hypotheses`."""
    hypotheses: int
    """Largest number of hypotheses of one estimate; 0 if there were none."""
    onboarding_s: dict[str, float]
    """Time to onboard each part, the maximum over all processes."""

    @property
    def look(self) -> Look:
        """Return the look of the bins."""
        return self.bins[0].look


class BinScorer(Closing):
    """Scores one source of estimates on bins of the pose benchmark. A context manager."""

    def __init__(self, source: PoseSource, detections: Sequence[str]) -> None:
        """Score `source` with each of these detection presets."""
        self._source, self._detections = source, detections
        self._evaluator = PoseEvaluator(library_model)

    def score(self, bin: BenchmarkBin) -> BinScore:
        """Estimate and score one bin."""
        view = load_view(bin)
        known = set(self._source.onboarding_s)
        errors, choices, hypotheses = {}, {}, 0
        images = (_image(view, name) for name in self._detections)
        for preset, answer in zip(self._detections, answers(images, self._source), strict=True):
            errors[preset] = self._evaluator.score(answer)
            hypotheses = max([hypotheses, *(len(estimate.hypotheses) for estimate in answer.estimates)])
            for k in (*BEST_OF, None):
                chosen = best_of(answer, k, library_model)
                choices[preset, k] = self._evaluator.instance_errors(answer.image, chosen)
        new = {part: seconds for part, seconds in self._source.onboarding_s.items() if part not in known}
        return BinScore(fingerprint(view), errors, choices, hypotheses, new)

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        self._evaluator.close()


def make_views(bins: Sequence[BenchmarkBin], *, workers: int = 1, console: Console | None = None) -> int:
    """Simulate and render the bins that are not cached yet and return their number."""
    missing = [bin for bin in bins if not view_path(bin).exists()]
    return sum(_mapped(_make_view, missing, workers, "making bins", console))


def export_bins(bins: Sequence[BenchmarkBin], folder: Path, console: Console | None = None) -> None:
    """Write bins as a BOP data set, without detections: scene ids are the seeds, object ids number `MIXED_PARTS`.

    Raises:
        OutputError: the folder cannot be written, or holds some of the bins already.
    """
    with BopWriter(folder, [get_part(name) for name in MIXED_PARTS]) as writer:
        writer.check_new([bin.seed for bin in bins])
        for bin in track(bins, "writing bins", console=console):
            view, visibilities = fresh_view(bin)
            export_bin(writer, BinImage(view.image([]), visibilities))
    if console is not None:
        console.print_line(f"data set: {folder}")


def run_pose_benchmark(
    estimator: str,
    *,
    detections: Sequence[str] = ("learned", "perfect"),
    bins: int | None = None,
    look: Look = "default",
    hypotheses: int | None = None,
    budget: PoseBudget | None = None,
    workers: int = 1,
    console: Console | None = None,
) -> PoseBenchmarkResult:
    """Score an estimator, by name, on the first `bins` bins of the pose benchmark, or on all.

    Raises:
        UnknownNameError: there is no estimator or there are no detections of this name.
        ConfigError: no preset is given, there are not so many bins, `workers` is not positive, or the estimator does
            not take a number of hypotheses or a budget.
    """
    chosen = benchmark_bins(bins, look)
    if not detections:
        raise ConfigError("detections must be of one preset or more, such as perfect and realistic, got none")
    if workers < 1:
        raise ConfigError(f"workers must be 1 or more, got {workers}")
    source = make_source(estimator, get_part, hypotheses, budget)
    in_worker = partial(_score, estimator, tuple(detections), hypotheses, budget)
    with BinScorer(source, detections) as scorer:
        scores = _mapped(scorer.score if workers == 1 else in_worker, chosen, workers, estimator, console)
    return summarize_scores(estimator, chosen, detections, scores)


def summarize_scores(
    estimator: str, bins: Sequence[BenchmarkBin], detections: Sequence[str], scores: Sequence[BinScore]
) -> PoseBenchmarkResult:
    """Return the result over all bins."""
    onboarding_s: dict[str, float] = {}
    for score in scores:
        for part, seconds in score.onboarding_s.items():
            onboarding_s[part] = max(seconds, onboarding_s.get(part, 0.0))
    hypotheses = max((score.hypotheses for score in scores), default=0)
    # The best of 50 is not reported where only 5 are made; the best of as many as were made is the best of all.
    shown = {k: k for k in BEST_OF if k <= hypotheses} | ({hypotheses: None} if hypotheses > 1 else {})
    best = {
        (preset, number): summarize_instances([i for score in scores for i in score.best_of[preset, k]])
        for preset in detections
        for number, k in sorted(shown.items())
    }
    return PoseBenchmarkResult(
        estimator,
        tuple(bins),
        hashlib.sha256(" ".join(score.fingerprint for score in scores).encode()).hexdigest()[:12],
        {preset: PoseEvaluation.of([score.errors[preset] for score in scores]) for preset in detections},
        {preset: tuple(BinFigures.of(score.errors[preset]) for score in scores) for preset in detections},
        best,
        hypotheses,
        dict(sorted(onboarding_s.items())),
    )


def _image(view: BinView, detections: str) -> PoseImage:
    """Return a bin's image with detections by name or from a file."""
    return view.image(detections_of_bin(Path(detections), view, MIXED_PARTS) if is_file(detections) else detections)


def _make_view(bin: BenchmarkBin) -> bool:
    load_view(bin)
    return True


def _score(
    estimator: str, detections: tuple[str, ...], hypotheses: int | None, budget: PoseBudget | None, bin: BenchmarkBin
) -> BinScore:
    return _scorer(estimator, detections, hypotheses, budget).score(bin)


@cache
def _scorer(
    estimator: str, detections: tuple[str, ...], hypotheses: int | None, budget: PoseBudget | None
) -> BinScorer:
    """Return a worker process's scorer, which lives as long as the process and keeps onboarded parts."""
    return BinScorer(make_source(estimator, get_part, hypotheses, budget), detections)


def _mapped(
    job: Callable[[BenchmarkBin], _Result],
    bins: Sequence[BenchmarkBin],
    workers: int,
    description: str,
    console: Console | None,
) -> list[_Result]:
    """Return the job's results in order, computed in this process or in a pool, with a progress bar."""
    with WorkerPool(workers, UNLIMITED) if workers > 1 and len(bins) > 1 else nullcontext() as pool:
        results: Iterable[_Result] = map(job, bins)
        if pool is not None:
            calls = [pool.submit(job, bin) for bin in bins]
            results = (call.result() for call in calls)
        return list(track(results, description, total=len(bins), console=console))
