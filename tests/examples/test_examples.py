"""Each example runs, with small bins, and gives what it promises."""

import re
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simpick.training.budget import Budget
from tests.training.conftest import TINY_TRAINING

pytestmark = pytest.mark.render
FOLDER = Path(__file__).parents[2] / "examples"


def main_of(number: int) -> Callable[..., Any]:
    (file,) = FOLDER.glob(f"{number:02}_*.py")
    return runpy.run_path(str(file))["main"]


def test_examples_are_short() -> None:
    lengths = {file.name: len(file.read_text().splitlines()) for file in FOLDER.glob("*.py")}
    assert len(lengths) == 8
    assert max(lengths.values()) < 60, lengths


def test_examples_are_pages_of_the_documentation() -> None:
    page = (FOLDER.parent / "docs/tutorials/examples.md").read_text()
    for file in FOLDER.glob("*.py"):
        assert f"--8<--\nexamples/{file.name}\n--8<--" in page


def test_python_in_readme(capsys) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (FOLDER.parent / "README.md").read_text(), re.DOTALL)
    exec(code.replace('"refined"', '"retrieval"').replace("count=8", "count=1"), {})
    assert re.search(r"^\d+\.\d deg, \d+\.\d mm$", capsys.readouterr().out, re.MULTILINE)


def test_step_the_environment(capsys) -> None:
    main_of(1)(count=2, steps=1)
    assert "reward" in capsys.readouterr().out


def test_pick_with_true_poses() -> None:
    assert main_of(2)(count=1) == 1


def test_estimate_poses() -> None:
    assert main_of(3)(mode="retrieval", count=2) < 30


def test_your_cad_part(tmp_path: Path) -> None:
    assert main_of(4)(tmp_path, count=2).stat().st_size > 0


def test_your_estimator() -> None:
    assert main_of(5)(count=1) == 1


def test_record_an_episode(tmp_path: Path) -> None:
    assert main_of(6)(tmp_path / "episode.rrd", "retrieval", count=1) >= 1


def test_compare_modes(tmp_path: Path) -> None:
    assert main_of(7)(tmp_path, episodes=1, count=1) == ["oracle", "retrieval"]


def test_train_raypose(tmp_path: Path) -> None:
    estimator = main_of(8)(tmp_path, TINY_TRAINING, Budget(steps=2))
    assert estimator.mode == "fine"
    assert all(np.isfinite(p.detach().numpy()).all() for p in estimator.model.parameters())
