"""What instances are, judged together with the others of their image."""

import numpy as np
import pytest

from simpick.estimators.detector.composition import JudgedInstances, judge_instances


def judged(
    similarity: list[list[float]],
    *,
    exposure: float = 0.5,
    masks: float = 0.9,
    bonus: list[list[float]] | None = None,
    view_odds: list[list[float]] | None = None,
) -> JudgedInstances:
    nothing = np.zeros((len(similarity), len(similarity[0])))
    return judge_instances(
        np.array(similarity),
        nothing if bonus is None else np.array(bonus),
        None if view_odds is None else np.array(view_odds),
        np.full(len(similarity), exposure),
        np.full(len(similarity), masks),
        is_distance_known=True,
    )


SURE, DOUBTFUL, DISSIMILAR = [0.85], [0.63], [0.52]


def test_a_doubtful_instance_is_the_asked_part_where_the_image_holds_it() -> None:
    among_parts = judged([SURE] * 8 + [DOUBTFUL])
    among_others = judged([DISSIMILAR] * 8 + [DOUBTFUL])
    assert among_parts.probability[-1] > 0.6 > 0.2 > among_others.probability[-1]


def test_an_image_without_the_asked_part_is_recognized() -> None:
    rng = np.random.default_rng(0)
    foreign = [[float(s)] for s in rng.normal(0.57, 0.06, 20)]
    assert judged(foreign).presence < 0.2
    assert judged([*foreign, *[SURE] * 3]).presence > 0.8
    assert judged([SURE] * 8).presence > 0.95


def test_names_that_the_image_holds_are_more_probable_for_its_other_instances() -> None:
    unsure = [0.7, 0.71, 0.2]
    alone = judged([unsure])
    assert alone.part[0] == 1
    together = judged([[0.85, 0.5, 0.2]] * 8 + [unsure])
    assert together.part[-1] == 0 and together.probability[-1] > alone.probability[0]


def test_evidence_decides_between_parts_but_not_whether_it_is_one_of_them() -> None:
    rivals = [[0.85, 0.84], [0.84, 0.85]]
    without = judged(rivals)
    decided = judged(rivals, bonus=[[0.0, 0.2], [0.0, 0.2]])
    assert decided.part.tolist() == [1, 1] and without.part.tolist() == [0, 1]
    assert (decided.probability > without.probability).all()
    assert decided.presence == pytest.approx(without.presence, abs=0.05)


def test_views_decide_between_parts_by_their_differences_alone() -> None:
    rivals = [[0.85, 0.84], [0.84, 0.85]]
    decided = judged(rivals, view_odds=[[-3.0, 2.0], [-3.0, 2.0]])
    assert decided.part.tolist() == [1, 1]
    shifted = judged(rivals, view_odds=[[7.0, 12.0], [7.0, 12.0]])
    np.testing.assert_allclose(shifted.probability, decided.probability)


def test_an_improbable_mask_is_an_improbable_detection() -> None:
    sure, unsure = (judged([SURE] * 4, masks=masks).probability[0] for masks in (0.95, 0.1))
    assert 0 < unsure < sure < 1


def test_exposed_instances_must_be_more_similar_than_hidden_ones() -> None:
    hidden, exposed = (judged([[0.66]] * 6, exposure=exposure).presence for exposure in (0.0, 1.0))
    assert hidden > exposed
