"""Distributions of how much instances resemble parts: what fitting recovers, and their tails."""

import numpy as np
import pytest

from simpick.estimators.detector.resemblance import Resemblance, fit_resemblance, regressors_of

TRUE = Resemblance(
    mean=((0.7, 10.0), (0.1, 2.0), (0.02, 0.5)),
    covariance=((0.006, 0.05), (0.05, 2.0)),
    deviation=(0.02, 1.2),
    freedom=None,
)


def images(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng, drawn = np.random.default_rng(5), []
    for _ in range(count):
        regressors = regressors_of(rng.uniform(0, 1, 12), int(rng.choice([1, 10, 28])))
        deviation = rng.normal() * np.array(TRUE.deviation)
        noise = rng.multivariate_normal(np.zeros(2), np.array(TRUE.covariance), 12)
        drawn.append((regressors @ np.array(TRUE.mean) + deviation + noise, regressors))
    return drawn


def test_a_fit_recovers_what_the_measures_were_drawn_from() -> None:
    found = fit_resemblance(images(600))
    np.testing.assert_allclose(np.array(found.mean), np.array(TRUE.mean), rtol=0.1, atol=0.03)
    np.testing.assert_allclose(np.array(found.covariance), np.array(TRUE.covariance), rtol=0.1, atol=0.005)
    np.testing.assert_allclose(np.abs(np.array(found.deviation)), np.array(TRUE.deviation), rtol=0.15, atol=0.01)


def test_the_deviation_of_an_image_moves_both_measures() -> None:
    regressors = regressors_of(np.array([0.5]), 1)
    middle = regressors @ np.array(TRUE.mean)
    steps = np.array([-1.0, 0.0, 1.0])
    at_middle = TRUE.log_density(middle, regressors, steps)[0]
    moved = TRUE.log_density(middle + np.array(TRUE.deviation), regressors, steps)[0]
    assert at_middle.argmax() == 1 and moved.argmax() == 2
    assert moved[2] == pytest.approx(at_middle[1])


def test_heavy_tails_are_heavy_and_agree_near_the_middle() -> None:
    heavy = Resemblance(TRUE.mean, TRUE.covariance, TRUE.deviation, 4.0)
    regressors = regressors_of(np.array([0.5, 0.5]), 1)
    measures = regressors @ np.array(TRUE.mean) + np.array([[0.0, 0.0], [0.0, -8.0]])
    normal, student = (r.log_density(measures, regressors, np.zeros(1))[:, 0] for r in (TRUE, heavy))
    assert student[0] == pytest.approx(normal[0])
    assert student[1] > normal[1] + 8
