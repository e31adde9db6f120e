"""Learning curves of a run from its log: a plot, a rerun recording, and the error over the amount of data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from simpick.errors import DatasetError
from simpick.json_text import load_json
from simpick.plotting import new_figure, save_figure
from simpick.recording.recording_file import RecordingFile

COUNTERS = ("step", "queries", "seconds")
"""Columns of every row of a log besides its split and its figures."""
# Panels of the picture: title, split, figures, whether the axis is logarithmic.
_PANELS = (
    ("loss and its terms", "train", None, True),
    ("median rotation error [deg]", "validation", ("rotation_deg",), True),
    ("share of sampled poses", "validation", ("below_5_deg", "below_15_deg", "below_30_deg"), False),
    ("median depth error [%], centre error [% of half a side]", "validation", ("depth_percent", "centre"), True),
    ("queries per second", "train", ("queries_per_s",), False),
    ("share of time waiting for data", "train", ("waiting_share",), False),
)
_RATES = ("queries_per_s", "waiting_share")


def read_log(file: Path) -> list[dict[str, Any]]:
    """Return the rows of a run's log, in order.

    Of steps that a resumed run repeated, the last rows count. An unfinished last line is left out.

    Raises:
        DatasetError: the file is missing, or a line is not a row of a log.
    """
    try:
        lines = file.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"there is no log of a training run at {file}: {error}") from error
    rows: list[dict[str, Any]] = []
    for number, line in enumerate(lines, 1):
        try:
            row = load_json(line)
            step = row["step"]
            if type(step) is not int:
                raise ValueError(f"step must be a whole number, got {step!r}")
            if not (row["split"] in ("train", "validation") and all(name in row for name in COUNTERS)):
                raise ValueError("it lacks a counter, or its split is unknown")
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            if number == len(lines):
                break
            raise DatasetError(f"line {number} of {file} must be a row of a training log: {error}") from error
        rows = [k for k in rows if k["step"] < step or (k["step"] == step and k["split"] != row["split"])]
        rows.append(row)
    return rows


def series(rows: Sequence[Mapping[str, Any]], split: str, figure: str) -> tuple[list[int], list[float]]:
    """Return the numbers of queries and the values of one figure."""
    chosen = [row for row in rows if row["split"] == split and figure in row]
    return [int(row["queries"]) for row in chosen], [float(row[figure]) for row in chosen]


def figures_of(rows: Sequence[Mapping[str, Any]], split: str) -> list[str]:
    """Return the names of the figures that a split's rows have."""
    names = dict.fromkeys(name for row in rows if row["split"] == split for name in row)
    return [name for name in names if name not in (*COUNTERS, "split")]


def plot_curves(rows: Sequence[Mapping[str, Any]], file: Path) -> None:
    """Draw losses, held-out errors of sampled poses and throughput against the queries seen."""
    rows = [{**row, "centre": 100 * row["centre_half_sides"]} if "centre_half_sides" in row else row for row in rows]
    figure = new_figure(13, 7)
    for axis, (title, split, names, is_log) in zip(figure.subplots(2, 3).flat, _PANELS, strict=True):
        for name in names or [name for name in figures_of(rows, split) if name not in _RATES]:
            queries, values = series(rows, split, name)
            width = 2.0 if name == "loss" or split == "validation" else 1.0
            axis.plot(queries, values, label=name, linewidth=width, marker="o" if len(values) < 30 else "")
        if is_log and any(line.get_ydata().size for line in axis.lines):
            axis.set_yscale("log")
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("queries seen")
        axis.grid(alpha=0.3, which="both")
        if len(axis.lines) > 1:
            axis.legend(fontsize=7)
    save_figure(figure, file)


def record_curves(rows: Sequence[Mapping[str, Any]], file: Path, *, recording_id: str) -> None:
    """Write every figure as a time series over ``step``, ``queries`` and ``training_time``; replaces the file.

    Raises:
        OutputError: the file cannot be written.
    """
    recording = RecordingFile(file, overwrite=True)
    try:
        stream = recording.open(recording_id)
        for split in ("train", "validation"):
            for name in figures_of(rows, split):
                chosen = [row for row in rows if row["split"] == split and name in row]
                nanoseconds = np.array([round(row["seconds"] * 1e9) for row in chosen], "timedelta64[ns]")
                rr.send_columns(
                    f"{split}/{name}",
                    [
                        rr.TimeColumn("step", sequence=[row["step"] for row in chosen]),
                        rr.TimeColumn("queries", sequence=[row["queries"] for row in chosen]),
                        rr.TimeColumn("training_time", duration=nanoseconds),
                    ],
                    rr.Scalars.columns(scalars=[float(row[name]) for row in chosen]),
                    recording=stream,
                )
    finally:
        recording.close()


def plot_scaling(runs: Mapping[str, Sequence[Mapping[str, Any]]], file: Path) -> None:
    """Draw the held-out median rotation error against queries seen, both on logarithmic axes, one line per run."""
    figure = new_figure(6, 4)
    axis = figure.subplots()
    for name, rows in runs.items():
        queries, values = series(rows, "validation", "rotation_deg")
        axis.plot(queries, values, marker="o", markersize=3, label=name)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlabel("queries seen")
    axis.set_ylabel("held-out median rotation error [deg]")
    axis.set_title("Sampled poses of held-out parts", fontsize=10)
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=8)
    save_figure(figure, file)


def write_curves(log: Path, *, recording_id: str) -> list[Path]:
    """Write ``curves.png``, ``scaling.png`` and ``curves.rrd`` beside a log and return them."""
    rows, folder = read_log(log), log.parent
    files = [folder / "curves.png", folder / "scaling.png", folder / "curves.rrd"]
    plot_curves(rows, files[0])
    plot_scaling({folder.name: rows}, files[1])
    record_curves(rows, files[2], recording_id=recording_id)
    return files
