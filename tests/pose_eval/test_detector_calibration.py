"""Fitting what the detector judges instances by."""

import json
from pathlib import Path

import numpy as np
import pytest

from simpick.cli.main import main
from simpick.errors import ConfigError
from simpick.estimators.detector.comparison import ComparedInstances
from simpick.estimators.detector.composition import judge_instances, read_composition
from simpick.pose_eval.benchmark_bins import load_view
from simpick.pose_eval.detector_calibration import (
    FOREIGN,
    FRAGMENT,
    LabelledInstances,
    calibration_bins,
    fit_composition,
    requests,
    write_composition,
)


def answer(seed: int, asked: float, foreign: float) -> LabelledInstances:
    rng = np.random.default_rng(seed)
    shown = np.array([0] * 6 + [FOREIGN] * 6 + [FRAGMENT] * 6)
    level = np.select([shown == 0, shown == FOREIGN], [asked, foreign], foreign - 0.05)
    similarity = level + rng.normal(0, 0.03, 18)
    views = 16 * similarity + rng.normal(0, 0.5, 18)
    scores = np.where(shown == FRAGMENT, 0.2, 0.9)
    exposure = rng.uniform(0, 1, 18)
    instances = ComparedInstances(
        [np.ones((2, 2), bool)] * 18, scores, exposure, similarity[:, None], views[:, None], np.zeros((18, 1)), True
    )
    return LabelledInstances(instances, shown)


def test_what_is_fitted_is_judged_by(tmp_path: Path) -> None:
    pairs = [(answer(k, 0.9, 0.6), answer(100 + k, 0.9, 0.6)) for k in range(8)]
    file = tmp_path / "composition.json"
    write_composition(fit_composition(pairs), {"made_by": "a test"}, file)
    assert json.loads(file.read_text())["made_by"] == "a test"
    model = read_composition(file)
    assert model.known_distance.asked.freedom == 4.0 and model.known_distance.foreign.freedom is None
    fresh = answer(77, 0.9, 0.6)
    judged = judge_instances(fresh.instances, model)
    assert judged.probability[fresh.shown == 0].min() > 0.6 > 0.3 > judged.probability[fresh.shown != 0].max()


def test_too_few_answers_are_refused() -> None:
    pairs = [(answer(k, 0.9, 0.6), answer(k, 0.9, 0.6)) for k in range(4)]
    with pytest.raises(ConfigError, match="needs 5 answers or more with each kind of instance, got 4; take more bins"):
        fit_composition(pairs)


@pytest.mark.render
def test_parts_that_are_there_and_parts_that_are_not_are_asked_for() -> None:
    bin = calibration_bins(4)[3]
    view = load_view(bin)
    asked = requests(bin, view)
    held = {part.name for part in view.parts}
    assert all(name.startswith("random_") for names in asked for name in names), "library parts stay unseen"
    assert asked[0] == bin.config.parts and any(not held & set(names) for names in asked)
    assert requests(bin, view) == asked


def test_a_file_is_not_replaced_unasked(tmp_path: Path, capsys) -> None:
    file = tmp_path / "composition.json"
    file.write_text("{}")
    assert main(["detector-calibrate", "--out", str(file)]) == 2
    assert "exists already. Choose another file with --out, or pass --overwrite" in capsys.readouterr().err
