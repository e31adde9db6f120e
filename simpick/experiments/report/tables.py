"""Runs and comparisons as tables for the terminal."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from simpick.estimators.detections import is_simulated, labelled
from simpick.experiments.analysis.failure_causes import Failure, FailureCause, count_causes
from simpick.experiments.analysis.grasp_scores import score_grasps
from simpick.experiments.analysis.paired import MEASURES, Measure, PairedStatistics
from simpick.experiments.config import RunConfig
from simpick.experiments.modes import ORACLE, parse_mode
from simpick.experiments.result_store import EpisodeResult
from simpick.metrics.intervals import Interval
from simpick.records import PickOutcome
from simpick.terminal import Table, narrow_table

DIFFERENCES = ("grasp_success", "first_try", "clearance", "mpph", "rotation_deg", "translation_mm")
"""Measures whose differences are shown."""
ONE_BIN_MEASURES = ("grasp_success", "clearance", "mpph", "rotation_deg", "translation_mm")
"""Measures that are shown of a single bin."""
TABLE_MEASURES = 3
"""Columns of a table: as many as fit beside the longest names of modes in 80 columns."""


def number(value: float, measure: Measure, *, sign: bool = False) -> str:
    """Return a value as it is read, without its unit."""
    if math.isnan(value):
        return "-"
    digits = 0 if measure.key == "mpph" else 2 if measure.unit in ("s", "deg", "mm") else 1
    return f"{value:{'+' if sign else ''}.{digits}f}"


def with_interval(interval: Interval, measure: Measure, *, sign: bool = False) -> str:
    """Return a value with its interval, such as ``69.9 (60.1 to 78.0)``, on two lines."""
    if not interval.is_known:
        return number(interval.value, measure, sign=sign)
    low, high = (number(bound, measure, sign=sign) for bound in (interval.low, interval.high))
    return f"{number(interval.value, measure, sign=sign)}\n({low} to {high})"


def share(value: float) -> str:
    """Return a share in percent, or "-" where there is none."""
    return "-" if math.isnan(value) else f"{value:.1%}"


def heading(measure: Measure) -> str:
    """Return a measure's title with its unit."""
    return f"{measure.title}, {measure.unit}" if measure.unit else measure.title


def scores_table(config: RunConfig, results: Sequence[EpisodeResult]) -> Table:
    """Return the grasp scores of one run."""
    scores = score_grasps(results)
    notes = ["true poses"] if config.estimator == ORACLE else []
    if config.noise_deg and config.noise_mm:  # The mode's name leaves out the noise where it has both kinds.
        notes += [f"{config.noise_deg:g} deg", f"{config.noise_mm:g} mm"]
    elif config.mode == ORACLE:
        notes.append("an upper bound")
    note = f" ({', '.join(notes)})" if notes else ""
    rows = {
        "episodes": f"{scores.episodes}",
        "attempts": f"{scores.attempts}",
        "abstentions": f"{scores.abstentions}",
        "grasp success": share(scores.grasp_success),
        "clearance": share(scores.clearance),
        "bins emptied": share(scores.cleared_episodes),
        "first-try success": share(scores.first_try_success),
        "mean picks per hour": _figure(scores.mpph, 0),
        "motion per attempt": _figure(scores.motion_s, 2, " s"),
        "perception per pick": _figure(scores.perception_s * 1e3, 0, " ms"),
        "median rotation error": _figure(scores.rotation_deg, 2, " deg"),
        "median translation error": _figure(scores.translation_mm, 2, " mm"),
    }
    rows |= {f"outcome {name}": f"{n}" for name, n in scores.outcomes.items()}
    title = f"{config.mode}{note}, {config.gripper}, {labelled(config.detections_used)}"
    return narrow_table("measure", "value", title=title, rows=rows.items())


def no_attempts_lines(results: Mapping[str, Sequence[EpisodeResult]]) -> list[str]:
    """Return for each mode without an attempt why there was none: the most frequent cause of its abstentions."""
    lines = []
    for mode, of_mode in results.items():
        if score_grasps(of_mode).attempts:
            continue
        valid = [result for result in of_mode if result.ended != PickOutcome.SIMULATION_FAULT]
        causes = Counter(pick.cause for result in valid for pick in result.picks)
        if causes:
            cause, count = causes.most_common(1)[0]
            lines.append(f"{mode}: no grasp was attempted in {causes.total()} picks; {count} times: {cause}")
        elif of_mode:
            lines.append(f"{mode}: no grasp was attempted: the physics diverged in every bin ({len(of_mode)})")
        else:
            lines.append(f"{mode}: no grasp was attempted: no bin is finished")
    return lines


def source_line(detections: str, modes: Sequence[str]) -> str:
    """Return what detections and which modes rest on the simulator's truth, in words."""
    line = labelled(detections)
    if any(parse_mode(mode).knows_truth for mode in modes):
        line += "; oracle modes have the true poses"
        line += ", an upper bound" if is_simulated(detections) else " of perfect detections, an upper bound"
    return line


def one_bin_table(statistics: PairedStatistics) -> Table:
    """Return the figures of a single bin, which has no intervals: a row per mode."""
    shown = [measure for measure in MEASURES if measure.key in ONE_BIN_MEASURES]
    rows = [
        (mode, *(number(statistics.measures[mode][measure.key].value, measure) for measure in shown))
        for mode in statistics.modes
    ]
    titles = [heading(measure).replace(" (MPPH)", "").replace(" ", "\n", 1) for measure in shown]
    return narrow_table("mode", *titles, title="one bin: no intervals; --episodes N takes more", rows=rows)


def modes_tables(statistics: PairedStatistics) -> list[Table]:
    """Return the figures: a row per mode, a column per measure."""
    title = f"{len(statistics.bins)} paired bins, 95 % intervals"
    return _tables(title, "mode", [(mode, statistics.measures[mode]) for mode in statistics.modes], MEASURES)


def differences_tables(statistics: PairedStatistics) -> list[Table]:
    """Return the paired differences: a row per pair of modes, a column per measure; * excludes zero."""
    rows = [(f"{d.mode}\n- {d.against}", d.measures) for d in statistics.differences]
    shown = [measure for measure in MEASURES if measure.key in DIFFERENCES]
    title = "differences over the same bins; * where the 95 % interval excludes zero"
    return _tables(title, "modes", rows, shown, differences=True) if rows else []


def causes_table(failures: Mapping[str, Sequence[Failure]]) -> Table:
    """Return the causes of each mode's failures: a row per mode, a column per cause."""
    columns = [title.replace(" ", "\n") for title in cause_headings()]
    rows = [(mode, *cause_cells(of_mode)) for mode, of_mode in failures.items()]
    # No padding, so that the longest name, ``retrieval_refined@50+closer``, fits into 80 columns.
    table = narrow_table("mode", *columns, title="failed picks in the same bins, by cause", rows=rows, padding=0)
    for column in table.columns[1:]:
        column.no_wrap = True
    return table


def cause_headings() -> list[str]:
    """Return the headings of `cause_cells`."""
    return [*(cause.value for cause in FailureCause), "all"]


def cause_cells(failures: Sequence[Failure]) -> list[str]:
    """Return how many failures are attributed to each cause, and how many there are in total."""
    return [*map(str, count_causes(failures).values()), str(len(failures))]


def _figure(value: float, digits: int, unit: str = "") -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}{unit}"


def _tables(
    title: str,
    label: str,
    rows: Sequence[tuple[str, Mapping[str, Interval]]],
    measures: Sequence[Measure],
    *,
    differences: bool = False,
) -> list[Table]:
    """Return tables of `TABLE_MEASURES` columns, so that any number of modes can be read in 80 columns."""
    tables = []
    for first in range(0, len(measures), TABLE_MEASURES):
        shown = measures[first : first + TABLE_MEASURES]
        table = narrow_table(label, *map(heading, shown), title=title if first == 0 else None, padding=2)
        for name, intervals in rows:
            cells = []
            for measure in shown:
                interval = intervals[measure.key]
                star = "*" if differences and interval.excludes_zero else ""
                cells.append(with_interval(interval, measure, sign=differences) + star)
            table.add_row(name, *cells)
        tables.append(table)
    return tables
