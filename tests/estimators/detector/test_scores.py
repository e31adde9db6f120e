"""Probabilities of masks and merges."""

import numpy as np
import pytest

from simpick.estimators.detector.scores import MaskScore, exposure, is_one_instance


def test_a_fitted_score_is_a_probability() -> None:
    rng = np.random.default_rng(0)
    features = rng.normal(size=(4000, 4))
    chance = 1 / (1 + np.exp(-(0.5 + features @ np.array([1.0, -2.0, 0.0, 0.5]))))
    score = MaskScore.fit(features, rng.random(4000) < chance)
    assert score.intercept == pytest.approx(0.5, abs=0.15)
    np.testing.assert_allclose(score.weights, [1.0, -2.0, 0.0, 0.5], atol=0.15)
    np.testing.assert_allclose(score(features), chance, atol=0.08)


@pytest.mark.parametrize("right", [True, False])
def test_nothing_is_fitted_where_all_or_none_are_right(right: bool) -> None:
    assert MaskScore.fit(np.zeros((5, 4)), np.full(5, right)) == MaskScore()


def test_exposure_is_the_share_of_surroundings_that_no_mask_covers() -> None:
    masks = np.zeros((3, 60, 60), bool)
    masks[0, 10:30, 10:30], masks[1, 10:30, 30:50], masks[2, 45:55, 5:15] = True, True, True
    first, second, apart = exposure(list(masks))
    assert apart == 1.0
    assert first == pytest.approx(second) and 0.6 < first < 0.85


def test_templates_decide_only_where_the_network_is_unsure() -> None:
    assert is_one_instance(0.45, 0.1) and not is_one_instance(0.45, -0.1)
    assert is_one_instance(0.95, -0.1) and not is_one_instance(0.05, 0.1)
