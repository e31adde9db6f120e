"""A comparison as tables for the terminal."""

from __future__ import annotations

import math

from rich.box import SIMPLE
from rich.table import Table

from simpick.evaluation.intervals import Interval
from simpick.evaluation.paired import MEASURES, Measure, PairedStatistics

DIFFERENCES = ("grasp_success", "first_try", "clearance", "mpph", "rotation_deg", "translation_mm")
"""Measures whose differences are told."""


def number(value: float, measure: Measure, *, sign: bool = False) -> str:
    """Return a value as it is read, without its unit."""
    if math.isnan(value):
        return "-"
    digits = 0 if measure.key == "mpph" else 2 if measure.unit in ("s", "deg", "mm") else 1
    return f"{value:{'+' if sign else ''}.{digits}f}"


def with_interval(interval: Interval, measure: Measure, *, sign: bool = False) -> str:
    """Return a value with its interval, such as ``69.9 (60.1 to 78.0)``."""
    if math.isnan(interval.low):
        return number(interval.value, measure, sign=sign)
    low, high = (number(bound, measure, sign=sign) for bound in (interval.low, interval.high))
    return f"{number(interval.value, measure, sign=sign)} ({low} to {high})"


def heading(measure: Measure) -> str:
    """Return a measure's title with its unit."""
    return f"{measure.title}, {measure.unit}" if measure.unit else measure.title


def modes_table(statistics: PairedStatistics) -> Table:
    """Return the figures: a row for each measure, a column for each mode."""
    table = Table(box=SIMPLE, title=f"{len(statistics.bins)} paired bins, 95 % intervals")
    table.add_column("measure")
    for mode in statistics.modes:
        table.add_column(mode, justify="right")
    for measure in MEASURES:
        cells = [with_interval(statistics.measures[mode][measure.key], measure) for mode in statistics.modes]
        table.add_row(heading(measure), *cells)
    return table


def differences_table(statistics: PairedStatistics) -> Table:
    """Return the paired differences: a row for each measure, a column for each pair of modes; * excludes zero."""
    table = Table(box=SIMPLE, title="differences over the same bins; * where the 95 % interval excludes zero")
    table.add_column("measure")
    for difference in statistics.differences:
        table.add_column(f"{difference.mode}\n- {difference.against}", justify="right")
    for measure in MEASURES:
        if measure.key in DIFFERENCES:
            cells = []
            for difference in statistics.differences:
                interval = difference.measures[measure.key]
                star = "*" if interval.excludes_zero else ""
                cells.append(with_interval(interval, measure, sign=True) + star)
            table.add_row(heading(measure), *cells)
    return table
