"""Paired comparison: every mode's figures over the same bins, their differences, and bootstrap intervals of both.

The bin is the unit of resampling, because attempts in one bin depend on each other. All modes are resampled with the
same draws of bins, so that a difference is taken within each resample: what makes a bin hard cancels. The resampling is
written here rather than with `scipy.stats.bootstrap`, whose draws differ: one draw of bins serves all measures, and the
intervals published so far stay as they are.

Source: Efron and Tibshirani, An Introduction to the Bootstrap (1993), percentile intervals.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from simpick.experiments.analysis.grasp_scores import ABSTENTIONS, first_try_successes, perception_time_s
from simpick.experiments.result_store import EpisodeResult
from simpick.metrics.intervals import Interval, percentile_interval, resample_bins, resampled_median, resampled_ratio
from simpick.records import PickOutcome, PickRecord

RESAMPLES = 2000


@dataclass(frozen=True)
class Measure:
    """One figure of a mode: a ratio of sums over bins, or a median over the attempts in all bins."""

    key: str
    title: str
    unit: str
    factor: float = 1.0
    """From the ratio of sums, or the median, to the unit."""


MEASURES: tuple[Measure, ...] = (
    Measure("grasp_success", "grasp success", "%", 100),
    Measure("first_try", "first-try success", "%", 100),
    Measure("clearance", "clearance", "%", 100),
    Measure("mpph", "picks per hour (MPPH)", "", 3600),
    Measure("rotation_deg", "rotation error", "deg"),
    Measure("translation_mm", "translation error", "mm"),
    Measure("depth_mm", "depth error", "mm"),
    Measure("collisions", "collisions", "%", 100),
    Measure("double_picks", "double picks", "%", 100),
    Measure("motion_s", "motion per attempt", "s"),
    Measure("perception_s", "perception per pick", "s"),
)
"""The figures of each mode. Errors are medians over attempts, at the moment of the pick."""

MEDIANS = ("rotation_deg", "translation_mm", "depth_mm")


@dataclass(frozen=True)
class Difference:
    """One mode minus another, over the same bins."""

    mode: str
    against: str
    measures: dict[str, Interval]


@dataclass(frozen=True)
class PairedStatistics:
    """The figures of a comparison."""

    modes: tuple[str, ...]
    bins: tuple[int, ...]
    """Episodes that every mode finished without a fault of the physics: all figures are over these."""
    left_out: tuple[int, ...]
    """Episodes that some mode has not finished, or in which the physics diverged."""
    measures: dict[str, dict[str, Interval]]
    """By mode and `Measure.key`."""
    differences: tuple[Difference, ...]
    """Each mode minus the first, then each minus its predecessor."""


def paired_bins(results: Iterable[EpisodeResult], modes: Sequence[str]) -> dict[str, list[EpisodeResult]]:
    """Return for each mode its results of the bins that all modes finished without a fault, in the same order."""
    by_key = {r.key: r for r in results if r.ended != PickOutcome.SIMULATION_FAULT}
    episodes = sorted({episode for episode, _ in by_key})
    common = [e for e in episodes if all((e, mode) in by_key for mode in modes)]
    return {mode: [by_key[e, mode] for e in common] for mode in modes}


def compare_modes(
    results: Sequence[EpisodeResult], modes: Sequence[str], rng: np.random.Generator, resamples: int = RESAMPLES
) -> PairedStatistics:
    """Return figures and paired differences of these modes with 95 % intervals, over the bins that all finished."""
    paired = paired_bins(results, modes)
    bins = tuple(r.episode for r in paired[modes[0]])
    left_out = tuple(sorted({r.episode for r in results if r.mode in modes} - set(bins)))
    counts = resample_bins(len(bins), resamples, rng)
    values = {mode: _values(paired[mode]) for mode in modes}
    replicates = {mode: _replicates(paired[mode], counts) for mode in modes}
    measures = {
        mode: {key: percentile_interval(values[mode][key], replicates[mode][key]) for key in values[mode]}
        for mode in modes
    }
    pairs = [(mode, modes[0]) for mode in modes[1:]] + [(modes[k], modes[k - 1]) for k in range(2, len(modes))]
    differences = tuple(
        Difference(
            a,
            b,
            {
                key: percentile_interval(values[a][key] - values[b][key], replicates[a][key] - replicates[b][key])
                for key in values[a]
            },
        )
        for a, b in pairs
    )
    return PairedStatistics(tuple(modes), bins, left_out, measures, differences)


def best_mode(statistics: PairedStatistics, candidates: Sequence[str]) -> str:
    """Return the mode with the highest product of grasp success and clearance; picks per hour decide a tie.

    Grasp success alone would favour a mode that picks the easiest parts and gives up; unknown figures count as zero.
    """

    def merit(mode: str) -> tuple[float, float]:
        figures = {key: float(np.nan_to_num(interval.value)) for key, interval in statistics.measures[mode].items()}
        return figures["grasp_success"] * figures["clearance"], figures["mpph"]

    return max(candidates, key=merit)


def executed(result: EpisodeResult) -> list[PickRecord]:
    """Return the grasps that the arm was sent to carry out."""
    return [pick for pick in result.picks if pick.outcome not in ABSTENTIONS]


def _values(results: Sequence[EpisodeResult]) -> dict[str, float]:
    whole = _replicates(results, np.ones((1, len(results)), int))
    return {key: float(value[0]) for key, value in whole.items()}


def _replicates(
    results: Sequence[EpisodeResult], counts: Int[np.ndarray, "resamples bins"]
) -> dict[str, Float[np.ndarray, "resamples"]]:
    """Return every measure in every resample of the bins."""
    sums = [_sums(result) for result in results]
    ratio_of = {
        "grasp_success": ("successes", "attempts"),
        "first_try": ("first_try_successes", "first_tries"),
        "clearance": ("delivered", "parts"),
        "mpph": ("successes", "robot_s"),
        "collisions": ("collisions", "attempts"),
        "double_picks": ("double_picks", "attempts"),
        "motion_s": ("motion_s", "attempts"),
        "perception_s": ("perception_s", "picks"),
    }
    errors, bin_of = _errors(results)
    replicates = {}
    for measure in MEASURES:
        if measure.key in MEDIANS:
            found = resampled_median(counts, errors[measure.key], bin_of)
        else:
            above, below = ([s[key] for s in sums] for key in ratio_of[measure.key])
            found = resampled_ratio(counts, np.array(above, float), np.array(below, float))
        replicates[measure.key] = measure.factor * found
    return replicates


def _sums(result: EpisodeResult) -> Mapping[str, float]:
    """Return what one bin contributes to numerators and denominators, counted as in `score_grasps`."""
    attempts = executed(result)
    first = first_try_successes(result)
    motion_s = sum(pick.motion_s for pick in attempts)
    perception_s = sum(perception_time_s(pick) for pick in result.picks)
    return {
        "attempts": len(attempts),
        "picks": len(result.picks),
        "successes": sum(pick.outcome is PickOutcome.SUCCESS for pick in attempts),
        "first_tries": len(first),
        "first_try_successes": sum(first),
        "parts": len(result.instances),
        "delivered": result.delivered,
        "collisions": sum(pick.outcome is PickOutcome.COLLISION for pick in attempts),
        "double_picks": sum(pick.outcome is PickOutcome.DOUBLE_PICK for pick in attempts),
        "motion_s": motion_s,
        "perception_s": perception_s,
        "robot_s": motion_s + perception_s,
    }


def _errors(results: Sequence[EpisodeResult]) -> tuple[dict[str, Float[np.ndarray, "n"]], Int[np.ndarray, "n"]]:
    """Return the pose errors of all attempts, and which of `results` each comes from."""
    rows = [
        (k, pick.pose_error.rotation_deg, pick.pose_error.translation_mm, abs(pick.pose_error.depth_mm))
        for k, result in enumerate(results)
        for pick in executed(result)
        if pick.pose_error is not None
    ]
    table = np.array(rows, float).reshape(-1, 4)
    return dict(zip(MEDIANS, table[:, 1:].T, strict=True)), table[:, 0].astype(int)
