"""What instances are, judged together with the others of their image."""

import json
from pathlib import Path

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.estimators.detector.comparison import ComparedInstances
from simpick.estimators.detector.composition import (
    SHIPPED_FILE,
    JudgedInstances,
    judge_instances,
    read_composition,
)


def judged(
    similarity: list[list[float]],
    *,
    exposure: float = 0.5,
    masks: float = 0.9,
    colours: list[list[float]] | None = None,
    views: list[list[float]] | None = None,
) -> JudgedInstances:
    """Judge instances whose views resemble the parts as their descriptors do, unless said otherwise."""
    alike = np.array(similarity)
    instances = ComparedInstances(
        [np.ones((2, 2), bool)] * len(alike),
        np.full(len(alike), masks),
        np.full(len(alike), exposure),
        alike,
        6.5 + 16 * (alike - 0.57) if views is None else np.array(views),
        np.zeros(alike.shape) if colours is None else np.array(colours),
        True,
    )
    return judge_instances(instances, read_composition())


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
    decided = judged(rivals, colours=[[0.0, 0.2], [0.0, 0.2]])
    assert decided.part.tolist() == [1, 1] and without.part.tolist() == [0, 1]
    assert (decided.probability > without.probability).all()
    assert decided.presence == pytest.approx(without.presence, abs=0.05)


def test_views_decide_between_parts() -> None:
    rivals = [[0.85, 0.84], [0.84, 0.85]]
    decided = judged(rivals, views=[[7.0, 12.0], [7.0, 12.0]])
    assert decided.part.tolist() == [1, 1]


def test_views_say_whether_it_is_the_asked_part() -> None:
    foreign, asked = (judged([DOUBTFUL] * 8, views=[[odds]] * 8) for odds in (6.0, 12.0))
    assert foreign.presence < 0.3 and asked.presence > 0.75


def test_one_asked_part_among_many_others_is_found() -> None:
    rng = np.random.default_rng(3)
    others = [[float(s)] for s in rng.normal(0.58, 0.04, 25)]
    views = [[float(v)] for v in rng.normal(6.5, 0.8, 25)]
    without, answer = judged(others, views=views), judged([*others, SURE], views=[*views, [13.0]])
    assert answer.presence > 0.4 > 0.2 > without.presence
    assert answer.probability[-1] > 0.4 > 0.1 > answer.probability[:-1].max()


def test_an_improbable_mask_is_an_improbable_detection() -> None:
    sure, unsure = (judged([SURE] * 4, masks=masks).probability[0] for masks in (0.95, 0.1))
    assert 0 < unsure < sure < 1


def test_exposed_instances_must_be_more_similar_than_hidden_ones() -> None:
    hidden, exposed = (judged([[0.66]] * 6, exposure=exposure).presence for exposure in (0.0, 1.0))
    assert hidden > exposed


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda content: content.pop("free_distance"), "free_distance is missing"),
        (lambda content: content["known_distance"]["asked"].update(mean=[[1, 2]]), "must be a tuple"),
        (lambda content: content["known_distance"]["asked"].update(freedom=0.5), "freedom must be between 1"),
        (lambda content: content["free_distance"]["foreign"].update(covariance=[[1, 2], [2, 1]]), "positive definite"),
    ],
)
def test_a_damaged_file_of_distributions_says_how_to_make_it_again(change, text: str, tmp_path: Path) -> None:
    content = json.loads(SHIPPED_FILE.read_text())
    change(content)
    file = tmp_path / "composition.json"
    file.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=f"composition.json.*{text}.*make it again with: simpick detector-calibrate"):
        read_composition(file)
