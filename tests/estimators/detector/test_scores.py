"""Probabilities of masks and names."""

import numpy as np
import pytest

from simpick.estimators.detector.scores import MaskScore, exposure, is_one_instance, name_probability


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


def test_a_similar_and_unrivalled_part_is_probably_right() -> None:
    similarity = np.array([[0.85, 0.6], [0.85, 0.84], [0.5, 0.3]])
    sure, rivalled, foreign = name_probability(similarity, np.zeros((3, 2)), np.ones(3), is_distance_known=False)
    assert sure > 0.95 > 0.8 > rivalled > foreign


def test_a_lone_part_is_compared_with_foreign_objects() -> None:
    similar, dissimilar = name_probability(
        np.array([[0.85], [0.55]]), np.zeros((2, 1)), np.ones(2), is_distance_known=False
    )
    assert similar > 0.85 and dissimilar < 0.1
    hidden = name_probability(np.array([[0.55]]), np.zeros((1, 1)), np.zeros(1), is_distance_known=False)
    assert hidden[0] > dissimilar, "what others hide is expected to be less similar"


def test_exposed_parts_are_kept_at_a_similarity_that_may_be_by_chance_where_the_distance_is_free() -> None:
    asked = np.array([[0.7]]), np.zeros((1, 1)), np.ones(1)
    free, known = (float(name_probability(*asked, is_distance_known=is_known)[0]) for is_known in (False, True))
    assert free < 0.4 < 0.6 < known


def test_evidence_decides_between_parts_but_not_whether_it_is_one_of_them() -> None:
    similarity = np.array([[0.85, 0.84], [0.5, 0.49]])
    without, foreign = name_probability(similarity, np.zeros((2, 2)), np.ones(2), is_distance_known=False)
    decided, still_foreign = name_probability(
        similarity, np.array([[0.2, 0.0], [0.2, 0.0]]), np.ones(2), is_distance_known=False
    )
    assert decided > 0.95 > without and still_foreign <= foreign + 0.01


def test_exposure_is_the_share_of_surroundings_that_no_mask_covers() -> None:
    masks = np.zeros((3, 60, 60), bool)
    masks[0, 10:30, 10:30], masks[1, 10:30, 30:50], masks[2, 45:55, 5:15] = True, True, True
    first, second, apart = exposure(list(masks))
    assert apart == 1.0
    assert first == pytest.approx(second) and 0.6 < first < 0.85


def test_templates_decide_only_where_the_network_is_unsure() -> None:
    assert is_one_instance(0.45, 0.1) and not is_one_instance(0.45, -0.1)
    assert is_one_instance(0.95, -0.1) and not is_one_instance(0.05, 0.1)
