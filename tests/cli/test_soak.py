"""``simpick soak`` on the smallest bins."""

import json
from pathlib import Path

import cv2
import pytest

from simpick.cli.main import main

pytestmark = pytest.mark.render

SMALL = ("--parts", "hex_nut", "--count", "1", "--estimator", "oracle", "--detections", "perfect", "--episodes", "2")


def test_a_soak_leaves_figures_a_plot_and_a_verdict(tmp_path: Path, capsys) -> None:
    out = tmp_path / "soak"
    assert main(["soak", *SMALL, "--out", str(out)]) == 0
    written = json.loads((out / "soak.json").read_text())
    assert [row["delivered"] for row in written["episodes"]] == [1, 1]
    plot = cv2.imread(str(out / "soak.png"))
    assert plot is not None and plot.std() > 5
    assert "verdict after 2 episodes: undecided" in capsys.readouterr().out
    assert main(["soak", *SMALL, "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err
