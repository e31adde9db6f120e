"""Whatever a file of a fitted model holds: probabilities, or an error that names the file and how to make it again."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from simpick.errors import ConfigError
from simpick.estimators.detector import composition
from simpick.estimators.detector.comparison import ComparedInstances
from simpick.estimators.refiner import confidence
from tests.damage import FUZZ, damaged_bytes, damaged_value, refusing

RNG = np.random.default_rng(0)
INSTANCES = {
    is_known: ComparedInstances(
        [np.ones((2, 2), bool)] * 4,
        np.array([0.0, 0.3, 0.9, 1.0]),
        np.array([0.0, 0.2, 0.7, 1.0]),
        RNG.uniform(0.3, 1.0, (4, 3)),
        RNG.uniform(0.0, 12.0, (4, 3)),
        np.zeros((4, 3)),
        is_known,
    )
    for is_known in (False, True)
}


def check_composition(file: Path) -> None:
    with refusing(ConfigError, file.name):
        model = composition.read_composition(file)
        for instances in INSTANCES.values():
            answer = composition.judge_instances(instances, model)
            assert 0 <= answer.presence <= 1 + 1e-9
            assert ((answer.probability >= 0) & (answer.probability <= 1 + 1e-9)).all()


def check_confidence(file: Path) -> None:
    with refusing(ConfigError, file.name):
        model = confidence.read_confidence(file)
        with np.errstate(over="ignore"):  # exp(1000) is infinite, and the probability 0.
            probability = model.probability(RNG.normal(size=(8, len(confidence.FEATURES))))
        assert ((probability >= 0) & (probability <= 1)).all()


@FUZZ
@given(value=damaged_value(json.loads(composition.SHIPPED_FILE.read_text())))
def test_edited_distributions_of_instances(tmp_path: Path, value: Any) -> None:
    file = tmp_path / "composition.json"
    file.write_text(json.dumps(value))
    check_composition(file)


@FUZZ
@given(content=damaged_bytes(composition.SHIPPED_FILE.read_bytes()))
def test_damaged_distributions_of_instances(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "composition.json"
    file.write_bytes(content)
    check_composition(file)


@FUZZ
@given(value=damaged_value(json.loads(confidence.SHIPPED_FILE.read_text())))
def test_edited_weights_of_confidence(tmp_path: Path, value: Any) -> None:
    file = tmp_path / "confidence.json"
    file.write_text(json.dumps(value))
    check_confidence(file)


@FUZZ
@given(data=st.data())
def test_damaged_weights_of_confidence(tmp_path: Path, data: st.DataObject) -> None:
    file = tmp_path / "confidence.json"
    file.write_bytes(data.draw(damaged_bytes(confidence.SHIPPED_FILE.read_bytes())))
    check_confidence(file)
