"""Measuring estimators on the yardstick, bin by bin, in order or in several processes."""

from __future__ import annotations

import hashlib
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from typing import TypeVar

from simpick.assets.library import get_part
from simpick.errors import ConfigError
from simpick.estimators.registry import PoseBudget
from simpick.metrics.scores import average_recalls
from simpick.metrics.summaries import PoseSummary
from simpick.pose_eval.benchmark_bins import BenchmarkBin, benchmark_bins, fingerprint, load_view, view_path
from simpick.pose_eval.best_of import best_of
from simpick.pose_eval.pose_evaluation import (
    ImageErrors,
    InstanceError,
    PoseEvaluation,
    PoseEvaluator,
    summarize_instances,
)
from simpick.pose_eval.pose_images import PoseModel
from simpick.pose_eval.pose_sources import EstimatorSource, PoseSource, make_source
from simpick.terminal import Console, track
from simpick.workers import UNLIMITED, WorkerPool

BEST_OF = (1, 5, 50)
"""For how many hypotheses the best is told, besides for all that were offered."""

_Result = TypeVar("_Result")


@dataclass(frozen=True, eq=False)
class BinScore:
    """What one estimator did on one bin."""

    fingerprint: str
    """Of the bin's view."""
    errors: dict[str, ImageErrors]
    """By the preset of the detections."""
    best_of: dict[tuple[str, int | None], tuple[InstanceError, ...]]
    """By preset and number of hypotheses; None for all that each estimate came with."""
    hypotheses: int
    """The most that came with one estimate."""
    onboarding_s: dict[str, float]
    """Time to onboard each part that this bin brought to this process."""


@dataclass(frozen=True)
class BinFigures:
    """One bin's share of the figures; weighted by targets, their mean over bins is the figure over all."""

    targets: int
    ar: float
    """Average recall, in [0, 1]; 0 for a bin without targets."""
    below_5_deg: float
    """Share of targets that are turned less."""

    @staticmethod
    def of(errors: ImageErrors) -> BinFigures:
        """Return the figures of one bin's image."""
        scores = average_recalls(errors.targets)
        return BinFigures(scores.targets, scores.ar or 0.0, summarize_instances(errors.instances).recall_5_deg)


@dataclass(frozen=True, eq=False)
class PoseBenchmarkResult:
    """What one estimator did on all bins."""

    estimator: str
    bins: tuple[BenchmarkBin, ...]
    fingerprint: str
    """Of all views."""
    evaluations: dict[str, PoseEvaluation]
    """By the preset of the detections."""
    by_bin: dict[str, tuple[BinFigures, ...]]
    """By the preset of the detections, in the order of `bins`: what differences between estimators are told from."""
    best_of: dict[tuple[str, int], PoseSummary]
    """By preset and number of hypotheses: those of `BEST_OF` up to the most that came with one estimate, and that most.
    Best is what is turned least against the truth."""
    hypotheses: int
    """The most that came with one estimate; 0 if there were none."""
    onboarding_s: dict[str, float]
    """Time to onboard each part, the longest of all processes."""


class BinScorer:
    """Scores one source of estimates on bins of the yardstick. A context manager."""

    def __init__(self, source: PoseSource, noises: Sequence[str]) -> None:
        """Score `source` with detections of each of these presets."""
        self._source, self._noises = source, noises
        model_of = cache(lambda name: PoseModel.of(get_part(name)))
        self._model_of: Callable[[str], PoseModel] = model_of
        self._evaluator = PoseEvaluator(model_of)

    def score(self, bin: BenchmarkBin) -> BinScore:
        """Estimate and score one bin."""
        view = load_view(bin)
        known = self._onboarded()
        errors, choices, hypotheses = {}, {}, 0
        for noise in self._noises:
            image = view.image(noise)
            self._source.prepare(image)
            start = time.perf_counter()
            estimates = self._source.estimate(image)
            elapsed_s = time.perf_counter() - start
            errors[noise] = self._evaluator.add(image, estimates, elapsed_s)
            hypotheses = max([hypotheses, *(len(estimate.hypotheses) for estimate in estimates)])
            for k in (*BEST_OF, None):
                chosen = best_of(estimates, image, k, self._model_of)
                choices[noise, k] = self._evaluator.instance_errors(image, chosen)
        new = {part: seconds for part, seconds in self._onboarded().items() if part not in known}
        return BinScore(fingerprint(view), errors, choices, hypotheses, new)

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        self._evaluator.close()

    def __enter__(self) -> BinScorer:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _onboarded(self) -> dict[str, float]:
        return dict(self._source.onboarding_s) if isinstance(self._source, EstimatorSource) else {}


def make_views(bins: Sequence[BenchmarkBin], *, workers: int = 1, console: Console | None = None) -> int:
    """Simulate and render the bins that are not in the cache yet, and return how many they were."""
    missing = [bin for bin in bins if not view_path(bin).exists()]
    with _mapped(_make_view, missing, workers) as made:
        deque(track(made, "making bins", total=len(missing), console=console), maxlen=0)
    return len(missing)


def run_pose_benchmark(
    estimator: str,
    *,
    noises: Sequence[str] = ("perfect", "realistic"),
    bins: int | None = None,
    hypotheses: int | None = None,
    budget: PoseBudget | None = None,
    workers: int = 1,
    console: Console | None = None,
) -> PoseBenchmarkResult:
    """Measure an estimator, by name, on the first `bins` bins of the yardstick, or on all.

    Raises:
        UnknownNameError: no estimator or no preset of detections has this name.
        ConfigError: no preset is given, there are not so many bins, `workers` is not positive, or the estimator does
            not take a number of hypotheses or a budget.
    """
    chosen = benchmark_bins(bins)
    if not noises:
        raise ConfigError("detections must be of one preset or more, such as perfect and realistic, got none")
    if workers < 1:
        raise ConfigError(f"workers must be 1 or more, got {workers}")
    source = make_source(estimator, get_part, hypotheses, budget)
    if workers == 1:
        with BinScorer(source, noises) as scorer:
            results = map(scorer.score, chosen)
            scores = list(track(results, estimator, total=len(chosen), console=console))
    else:
        job = partial(_score, estimator, tuple(noises), hypotheses, budget)
        with _mapped(job, chosen, workers) as results:
            scores = list(track(results, estimator, total=len(chosen), console=console))
    return summarize_scores(estimator, chosen, noises, scores)


def summarize_scores(
    estimator: str, bins: Sequence[BenchmarkBin], noises: Sequence[str], scores: Sequence[BinScore]
) -> PoseBenchmarkResult:
    """Return the result over all bins."""
    onboarding_s: dict[str, float] = {}
    for score in scores:
        for part, seconds in score.onboarding_s.items():
            onboarding_s[part] = max(seconds, onboarding_s.get(part, 0.0))
    hypotheses = max((score.hypotheses for score in scores), default=0)
    # Best of 50 is no figure where only 5 are offered; of as many as were offered, it is the best of all.
    told = {k: k for k in BEST_OF if k <= hypotheses} | ({hypotheses: None} if hypotheses > 1 else {})
    best = {
        (noise, shown): summarize_instances([i for score in scores for i in score.best_of[noise, k]])
        for noise in noises
        for shown, k in sorted(told.items())
    }
    return PoseBenchmarkResult(
        estimator,
        tuple(bins),
        hashlib.sha256(" ".join(score.fingerprint for score in scores).encode()).hexdigest()[:12],
        {noise: PoseEvaluation.of([score.errors[noise] for score in scores]) for noise in noises},
        {noise: tuple(BinFigures.of(score.errors[noise]) for score in scores) for noise in noises},
        best,
        hypotheses,
        dict(sorted(onboarding_s.items())),
    )


def _make_view(bin: BenchmarkBin) -> None:
    load_view(bin)


def _score(
    estimator: str, noises: tuple[str, ...], hypotheses: int | None, budget: PoseBudget | None, bin: BenchmarkBin
) -> BinScore:
    return _scorer(estimator, noises, hypotheses, budget).score(bin)


@cache
def _scorer(estimator: str, noises: tuple[str, ...], hypotheses: int | None, budget: PoseBudget | None) -> BinScorer:
    """Return a worker's scorer, which lives as long as the worker and keeps what was onboarded."""
    return BinScorer(make_source(estimator, get_part, hypotheses, budget), noises)


@contextmanager
def _mapped(
    job: Callable[[BenchmarkBin], _Result], bins: Sequence[BenchmarkBin], workers: int
) -> Iterator[Iterable[_Result]]:
    """Yield the job's results in order, from this process or from a pool."""
    if workers == 1 or len(bins) < 2:
        yield map(job, bins)
        return
    with WorkerPool(workers, UNLIMITED) as pool:
        calls = [pool.submit(job, bin) for bin in bins]
        yield (call.result() for call in calls)
