"""``simpick refiner calibrate``: which bins it fits on, and what it writes."""

from __future__ import annotations

import json
import shlex
import sys

import numpy as np
import pytest

import simpick.estimators.refiner.refiner
import simpick.estimators.registry
import simpick.pose_eval.benchmark_bins
import simpick.pose_eval.refiner_calibration
from simpick.cli.main import main
from simpick.errors import ConfigError
from simpick.estimators.oracle import OracleEstimator
from simpick.estimators.refiner.confidence import FEATURES, read_confidence
from simpick.pose_eval.refiner_calibration import Outcomes


@pytest.fixture
def counts(monkeypatch) -> list[int]:
    """Return the instances of the bins that were made; poses and their outcomes are drawn instead of refined."""
    made: list[int] = []
    rng = np.random.default_rng(0)

    def drawn(views, estimator, detections) -> Outcomes:
        features = rng.uniform(size=(200, len(FEATURES)))
        good = (rng.random(200) < features.mean(axis=1)).astype(float)
        return Outcomes(np.arange(200), features, good)

    def refuse() -> None:
        raise ConfigError("the shipped weights are of other cues")

    monkeypatch.setattr(simpick.estimators.refiner.refiner, "read_confidence", refuse)
    monkeypatch.setattr(simpick.estimators.registry, "load_estimator", lambda name: OracleEstimator(lambda: ()))
    # The package's attribute of this name is the function in it.
    monkeypatch.setattr(sys.modules["simpick.pose_eval.benchmark_bins"], "benchmark_bins", lambda count: ())
    calibration = simpick.pose_eval.refiner_calibration
    monkeypatch.setattr(calibration, "random_bin", lambda number, parts, count: made.append(count))
    monkeypatch.setattr(calibration, "outcomes", drawn)
    return made


def test_the_bins_take_the_given_numbers_of_instances_in_turn(counts, tmp_path):
    assert main(shlex.split(f"refiner calibrate --bins 5 --count 24 3 --out {tmp_path}")) == 0
    assert counts == [24, 3, 24, 3, 24]


def test_one_number_holds_for_all_bins(counts, tmp_path):
    assert main(shlex.split(f"refiner calibrate --bins 2 --count 7 --out {tmp_path}")) == 0
    assert counts == [7, 7]


def test_weights_are_made_again_where_those_shipped_cannot_be_used_and_the_file_names_its_command(counts, tmp_path):
    command = "refiner calibrate --bins 3 --parts 2 --count 24 3 --check-bins 1 --detections perfect --starts fine@5"
    assert main([*shlex.split(command), "--out", str(tmp_path)]) == 0
    file = tmp_path / "confidence.json"
    assert len(read_confidence(file).weights) == len(FEATURES)
    assert json.loads(file.read_text())["made_by"] == f"simpick {command}"


def test_the_weight_of_rest_alone_is_fitted_on_request(counts, tmp_path):
    assert main(shlex.split(f"refiner calibrate --bins 1 --rest-only --out {tmp_path}")) == 0
    shipped, fitted = read_confidence(), read_confidence(tmp_path / "confidence.json")
    assert fitted.weights[:-1] == shipped.weights[:-1] and fitted.weights[-1] != shipped.weights[-1]
    assert json.loads((tmp_path / "confidence.json").read_text())["made_by"].endswith("--rest-only")
