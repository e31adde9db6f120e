"""Outcome and cause from evidence alone; one line a case."""

import pytest

from simpick.motion.verdict import Evidence, judge
from simpick.records import PickOutcome

BEFORE = (0, 1, 2)
GRIPPED = {"gripped": (1,), "lifted": (1,)}
CASES = {
    "delivered": (PickOutcome.SUCCESS, "part_01", {**GRIPPED, "in_bin_after": (0, 2), "in_chute_after": (1,)}),
    "lost in the chute's favour": (
        PickOutcome.SUCCESS,
        "part_01 was delivered",
        {**GRIPPED, "lost_at": "carry", "in_bin_after": (0, 2), "in_chute_after": (1,)},
    ),
    "two delivered": (
        PickOutcome.DOUBLE_PICK,
        "part_01 and part_02",
        {**GRIPPED, "in_bin_after": (0,), "in_chute_after": (1, 2)},
    ),
    "a second one came along and fell": (
        PickOutcome.DOUBLE_PICK,
        "part_02 came along with part_01",
        {"gripped": (1,), "lifted": (1, 2), "in_bin_after": (0,), "in_chute_after": (1,)},
    ),
    "delivered, but another pushed out": (
        PickOutcome.EJECTED,
        "part_02 left the bin and did not reach the chute; part_01 was delivered",
        {**GRIPPED, "in_bin_after": (0,), "in_chute_after": (1,)},
    ),
    "pushed out, nothing gripped": (
        PickOutcome.EJECTED,
        "part_02 left the bin and did not reach the chute; nothing",
        {"nothing_gripped": "nothing", "in_bin_after": (0, 1)},
    ),
    "flung into the chute": (
        PickOutcome.EJECTED,
        "part_01 was knocked into the chute without being gripped",
        {"collision": "floor", "in_bin_after": (0, 2), "in_chute_after": (1,)},
    ),
    "stuck on the gripper": (
        PickOutcome.EJECTED,
        "part_02 stuck to the gripper and was taken off; wall",
        {"stuck": (2,), "collision": "wall", "in_bin_after": (0, 1)},
    ),
    "slipped": (
        PickOutcome.SLIPPED,
        "part_01 slipped out of the gripper at stage lift with the TCP 700 mm",
        {"gripped": (1,), "lost_at": "lift", "lost_in_bin": True, "lost_height_m": 0.7, "in_bin_after": BEFORE},
    ),
    "dropped back into the bin": (
        PickOutcome.DROPPED,
        "fell out of the gripper at stage carry",
        {**GRIPPED, "lost_at": "carry", "in_bin_after": BEFORE},
    ),
    "dropped on the table": (
        PickOutcome.DROPPED,
        "fell out of the gripper at stage carry",
        {**GRIPPED, "lost_at": "carry", "in_bin_after": (0, 2)},
    ),
    "released beside the chute": (
        PickOutcome.DROPPED,
        "did not come to lie in it",
        {**GRIPPED, "in_bin_after": (0, 2)},
    ),
    "stuck after the gripped part was lost": (
        PickOutcome.EJECTED,
        "part_02 stuck to the gripper and was taken off; the gripped part was lost at stage carry",
        {**GRIPPED, "stuck": (2,), "lost_at": "carry", "in_bin_after": (0, 1)},
    ),
    "delivered while another stuck": (
        PickOutcome.SUCCESS,
        "part_01 was delivered",
        {**GRIPPED, "stuck": (1,), "in_bin_after": (0, 2), "in_chute_after": (1,)},
    ),
    "lost in a collision": (
        PickOutcome.COLLISION,
        "wall",
        {**GRIPPED, "collision": "wall", "lost_at": "carry", "in_bin_after": BEFORE},
    ),
    "pushed out though nothing else was noticed": (
        PickOutcome.EJECTED,
        "part_02 left the bin and did not reach the chute$",
        {**GRIPPED, "in_bin_after": (0, 1)},
    ),
    "pushed out in a collision": (
        PickOutcome.EJECTED,
        "part_02 left the bin and did not reach the chute; wall",
        {"collision": "wall", "nothing_gripped": "nothing", "in_bin_after": (0, 1)},
    ),
    "fault without a motion": (PickOutcome.SIMULATION_FAULT, "diverged", {"fault": "diverged", "unreachable": "far"}),
    "collision": (PickOutcome.COLLISION, "wall", {"collision": "wall", "in_bin_after": BEFORE}),
    "missed": (PickOutcome.MISSED, "closed", {"nothing_gripped": "closed", "in_bin_after": BEFORE}),
    "unreachable": (PickOutcome.UNREACHABLE, "too far", {"unreachable": "too far", "in_bin_after": BEFORE}),
    "fault": (PickOutcome.SIMULATION_FAULT, "diverged", {"fault": "diverged", "gripped": (1,)}),
}


@pytest.mark.parametrize("case", CASES)
def test_outcome_and_cause_follow_from_the_evidence(case):
    outcome, words, notes = CASES[case]
    verdict = judge(Evidence(in_bin=BEFORE, in_chute=(7,), **notes))
    assert verdict.outcome is outcome
    assert words.removesuffix("$") in verdict.cause
    assert not words.endswith("$") or verdict.cause.endswith(words[:-1]), "a $ stands for the end"


def test_parts_that_lay_in_the_chute_before_are_not_delivered_again():
    verdict = judge(Evidence(in_bin=BEFORE, in_chute=(7,), in_bin_after=(0, 2), in_chute_after=(1, 7), gripped=(1,)))
    assert verdict.delivered == (1,)
    assert verdict.ejected == ()


def test_what_left_the_bin_is_delivered_or_ejected_never_both():
    evidence = Evidence(BEFORE, (7,), in_bin_after=(), in_chute_after=(7, 2), gripped=(2,), lifted=(2,))
    verdict = judge(evidence)
    assert (verdict.delivered, verdict.ejected) == ((2,), (0, 1))


@pytest.mark.parametrize("notes", [{"fault": "diverged"}, {"unreachable": "too far"}])
def test_without_a_pick_nothing_is_delivered_or_ejected(notes):
    verdict = judge(Evidence(BEFORE, (7,), in_bin_after=(0,), in_chute_after=(1,), **notes))
    assert verdict.delivered == verdict.ejected == ()
