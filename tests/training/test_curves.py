"""Logs as curves, also those of runs that were stopped."""

import json
from pathlib import Path

import pytest

from simpick.errors import DatasetError
from simpick.training.curves import read_log, series


def row(step: int, split: str, value: float) -> str:
    figures = {"step": step, "queries": 4 * step, "seconds": 1.5 * step, "split": split, "figure": value}
    return json.dumps(figures) + "\n"


def test_steps_that_a_resumed_run_made_again_count_once(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    rows = [(20, "train", 1.0), (20, "validation", 9.0), (40, "train", 2.0), (60, "train", 3.0), (40, "train", 4.0)]
    log.write_text("".join(row(*r) for r in rows) + '{"step": 60, "que')
    assert series(read_log(log), "train", "figure") == ([80, 160], [1.0, 4.0])
    assert series(read_log(log), "validation", "figure") == ([80], [9.0])


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="there is no log of a training run at"):
        read_log(tmp_path / "log.jsonl")
    (tmp_path / "log.jsonl").write_text("nonsense\n" + row(20, "train", 1.0))
    with pytest.raises(DatasetError, match=r"line 1 of .* must be a row of a training log"):
        read_log(tmp_path / "log.jsonl")
