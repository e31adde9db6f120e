"""Probabilities from scores: the fit recovers a known model, and the shipped one is sane."""

from __future__ import annotations

import json

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.estimators.refiner.confidence import Confidence, fit_confidence, read_confidence
from simpick.pose_eval.refiner_calibration import write_confidence


def test_a_known_model_is_found_again():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(20_000, 6)) * [0.2, 0.4, 0.4, 0.2, 0.5, 0.3] + [0.5, 0.4, 0.4, 0.8, 1.5, 0.5]
    true = Confidence(-8.0, (3.0, 2.0, 2.5, 2.0, 1.5, 2.0))
    good = (rng.random(len(X)) < true.probability(X)).astype(float)
    fitted = fit_confidence(X, good)
    # Sampling leaves the weights off by a tenth or so, and the probabilities by half a percent on average.
    assert np.abs(fitted.probability(X) - true.probability(X)).mean() < 0.01


def test_the_weight_of_rest_is_found_again_beside_given_weights_of_the_image():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(20_000, 6)) * [0.2, 0.4, 0.4, 0.2, 0.5, 0.3] + [0.5, 0.4, 0.4, 0.8, 1.5, 0.5]
    image = (3.0, 2.0, 2.5, 2.0, 1.5)
    true = Confidence(-8.0, (*image, 2.0))
    good = (rng.random(len(X)) < true.probability(X)).astype(float)
    # The given model's bias and weight of rest do not matter.
    fitted = fit_confidence(X, good, image_weights_of=Confidence(5.0, (*image, -7.0)))
    assert fitted.weights[:5] == image
    assert fitted.bias == pytest.approx(true.bias, abs=0.1) and fitted.weights[5] == pytest.approx(2.0, abs=0.2)


def test_too_few_or_one_sided_outcomes_are_refused():
    with pytest.raises(ConfigError, match="needs 20 poses or more, good and bad ones, got 5"):
        fit_confidence(np.zeros((5, 6)), np.array([0.0, 1, 0, 1, 0]))
    with pytest.raises(ConfigError, match="good and bad ones"):
        fit_confidence(np.zeros((30, 6)), np.ones(30))


def test_a_written_model_is_read_back(tmp_path):
    model = Confidence(-1.0, (2.0, 0.5, 0.1, 1.0, 3.0, 2.0))
    write_confidence(model, {"made_by": "a test"}, tmp_path / "confidence.json")
    assert read_confidence(tmp_path / "confidence.json") == model


def test_the_shipped_model_trusts_a_good_fit_more():
    shipped = read_confidence()
    clear = shipped.probability(np.array([0.6, 0.7, 0.7, 0.9, 2.5, 0.5]))
    doubtful = shipped.probability(np.array([0.4, 0.1, 0.1, 0.6, 0.5, 0.5]))
    assert doubtful < 0.5 < clear


def test_the_shipped_model_trusts_a_lone_part_more_if_it_rests():
    cues = np.array([[0.5, 0.5, 0.5, 0.8, 1.5, rest] for rest in (0.05, 0.5, 1.0)])
    assert np.all(np.diff(read_confidence().probability(cues)) > 0.05)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "confidence.json must be a JSON file, cannot be read"),
        ('{"bias": 1.0, "wei', "cannot be read"),
        ("[1, 2]", "must hold a JSON object, got"),
        ('{"bias": 0, "weights": {"mask": 1}, "good": {"mm": 5.0, "deg": 10.0}}', "got weights {'mask': 1.0}"),
    ],
)
def test_a_file_that_holds_no_confidence_is_refused_with_what_to_do(tmp_path, text, said):
    file = tmp_path / "confidence.json"
    if text is not None:
        file.write_text(text)
    with pytest.raises(ConfigError, match=said) as refusal:
        read_confidence(file)
    assert "simpick refiner calibrate" in str(refusal.value)


@pytest.mark.parametrize(("key", "value"), [("bias", "0"), ("bias", float("nan")), ("good", {"mm": 2.0, "deg": 10.0})])
def test_values_of_another_kind_are_refused(tmp_path, key, value):
    file = tmp_path / "confidence.json"
    write_confidence(Confidence(-1.0, (2.0, 0.5, 0.1, 1.0, 3.0, 2.0)), {}, file)
    file.write_text(json.dumps({**json.loads(file.read_text()), key: value}))
    with pytest.raises(ConfigError, match=r"bias must be a finite number, got|must hold weights of"):
        read_confidence(file)
