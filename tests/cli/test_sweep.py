"""``simpick sweep`` and ``simpick benchmark`` on the smallest bins."""

import csv
from pathlib import Path

import cv2
import pytest

from simpick.cli.main import main

pytestmark = pytest.mark.render

ONE_PART = ("--parts", "pipe_tee", "--count", "1", "--episodes", "1")


def test_a_sweep_leaves_a_table_and_a_plot(tmp_path: Path, capsys) -> None:
    out = tmp_path / "sweep"
    levels = ("--levels-mm", "0", "80", "--levels-deg", "0")
    assert main(["sweep", *ONE_PART, *levels, "--out", str(out)]) == 0
    with (out / "sweep.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["unit"], float(row["noise"])) for row in rows] == [("mm", 0.0), ("mm", 80.0), ("deg", 0.0)]
    assert float(rows[0]["grasp_success"]) == 1.0 and float(rows[0]["clearance"]) == 1.0
    assert float(rows[1]["clearance"]) == 0.0, "nobody picks what lies 80 mm elsewhere"
    plot = cv2.imread(str(out / "sweep.png"))
    assert plot is not None and plot.std() > 5
    assert "oracle with noise" in capsys.readouterr().out


def test_a_sweep_refuses_bad_levels_before_it_runs_any(tmp_path: Path, capsys) -> None:
    out = tmp_path / "sweep"
    assert main(["sweep", *ONE_PART, "--levels-mm", "0", "-3", "--out", str(out)]) == 2
    assert "levels_mm[1] must be at least 0, got -3.0" in capsys.readouterr().err
    assert not out.exists()


def test_the_benchmark_reports_speed_and_shares(capsys) -> None:
    assert main(["benchmark", *ONE_PART]) == 0
    printed = capsys.readouterr().out
    assert "times faster than real time" in printed and "share of time outside MuJoCo" in printed
    assert "overhead colour" in printed and "images/s" in printed
