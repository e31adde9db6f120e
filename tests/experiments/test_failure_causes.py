"""Failures are attributed to causes by fixed rules."""

import dataclasses

import pytest

from simpick.experiments.analysis.failure_causes import FailureCause, failure_cause, find_failures
from simpick.records import PickOutcome, PoseError
from tests.experiments.test_result_store import make_pick, make_result

GOOD = PoseError(10.0, 5.0, 3.0, -4.0, 6.0)


@pytest.mark.parametrize(
    ("outcome", "error", "cause"),
    [
        (PickOutcome.SIMULATION_FAULT, PoseError(90, 90, 90, 0, 90), "physics"),
        (PickOutcome.NOTHING_DETECTED, None, "detection"),
        (PickOutcome.MISSED, None, "detection"),
        (PickOutcome.NO_GRASP, None, "grasp"),
        (PickOutcome.MISSED, PoseError(60, 30, 10, 29, 40), "symmetry flip"),
        (PickOutcome.COLLISION, PoseError(180, 2, 2, 0, 40), "symmetry flip"),
        (PickOutcome.MISSED, PoseError(60, 30, 10.1, 29, 40), "pose"),
        (PickOutcome.MISSED, PoseError(59, 2, 2, 0, 40), "pose"),
        (PickOutcome.COLLISION, PoseError(10.1, 0, 0, 0, 5), "pose"),
        (PickOutcome.SLIPPED, PoseError(0, 5.1, 0, 5.1, 5.1), "pose"),
        (PickOutcome.MISSED, GOOD, "grasp"),
        (PickOutcome.SLIPPED, GOOD, "grasp"),
        (PickOutcome.DOUBLE_PICK, GOOD, "grasp"),
        (PickOutcome.UNREACHABLE, GOOD, "motion"),
        (PickOutcome.COLLISION, GOOD, "motion"),
        (PickOutcome.DROPPED, GOOD, "physics"),
        (PickOutcome.EJECTED, GOOD, "physics"),
    ],
)
def test_rules(outcome: PickOutcome, error: PoseError | None, cause: str) -> None:
    assert failure_cause(dataclasses.replace(make_pick(0, outcome), pose_error=error)) == cause


def test_every_outcome_but_success_has_a_cause() -> None:
    for outcome in set(PickOutcome) - {PickOutcome.SUCCESS}:
        assert failure_cause(dataclasses.replace(make_pick(0, outcome), pose_error=GOOD)) in FailureCause


def test_a_target_that_is_no_part_was_a_wrong_detection() -> None:
    assert failure_cause(make_pick(0, PickOutcome.MISSED, None)) is FailureCause.DETECTION


def test_no_grasp_is_attributed_to_the_poses_where_the_oracle_found_more() -> None:
    gave_up = make_result(0, make_pick(0, target=1), make_pick(1, PickOutcome.NO_GRASP, None))
    oracle = make_result(0, make_pick(0, target=1), make_pick(1, target=0))
    equal = make_result(0, make_pick(0, target=0))
    assert [f.cause for f in find_failures([gave_up], [oracle])] == [FailureCause.POSE]
    assert [f.cause for f in find_failures([gave_up], [equal])] == [FailureCause.GRASP]
    assert [f.cause for f in find_failures([gave_up])] == [FailureCause.GRASP]


def test_a_failure_knows_whether_the_oracle_delivered_that_part() -> None:
    failed = make_result(0, make_pick(0, PickOutcome.MISSED, 1), make_pick(1, PickOutcome.MISSED, 0))
    oracle = make_result(0, make_pick(0, target=1))
    assert [f.oracle_delivered for f in find_failures([failed], [oracle])] == [True, False]
    assert [f.oracle_delivered for f in find_failures([failed], [make_result(7)])] == [None, None]


def test_all_parts_delivered_so_far_are_compared_with_the_oracles() -> None:
    picks = [make_pick(0), make_pick(1), make_pick(2, PickOutcome.NO_GRASP)]
    picks = [dataclasses.replace(p, delivered=(p.pick,) if p.pick < 2 else ()) for p in picks]
    result = dataclasses.replace(make_result(), picks=tuple(picks))
    oracle = dataclasses.replace(result, picks=tuple(picks[:2]))
    (failure,) = find_failures([result], [oracle])
    assert failure.cause is FailureCause.GRASP, "the oracle delivered two as well"
