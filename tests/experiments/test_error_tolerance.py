"""Success against pose error, counted by hand."""

import dataclasses

import pytest

from simpick.experiments.analysis.error_tolerance import success_by_error, success_by_pose
from simpick.records import PickOutcome, PickRecord, PoseError
from tests.experiments.test_result_store import make_pick


def pick(rotation_deg: float, translation_mm: float, outcome: PickOutcome) -> PickRecord:
    return dataclasses.replace(
        make_pick(0, outcome), pose_error=PoseError(rotation_deg, translation_mm, 0.0, translation_mm, translation_mm)
    )


PICKS = [
    pick(0.5, 1.0, PickOutcome.SUCCESS),
    pick(0.9, 45.0, PickOutcome.MISSED),
    pick(1.0, 5.0, PickOutcome.SLIPPED),
    pick(180.0, 2.0, PickOutcome.SUCCESS),
    dataclasses.replace(make_pick(1), pose_error=None),
]


def test_ranges_hold_their_lower_edge() -> None:
    rotation = {s.label: (s.successes, s.attempts) for s in success_by_error(PICKS, "rotation_deg") if s.attempts}
    assert rotation == {"0-1": (1, 2), "1-2": (0, 1), "over 45": (1, 1)}
    translation = {s.label: (s.successes, s.attempts) for s in success_by_error(PICKS, "translation_mm") if s.attempts}
    assert translation == {"1-2": (1, 1), "2-5": (1, 1), "5-10": (0, 1), "over 40": (0, 1)}


def test_good_poses_are_counted_apart_from_the_others() -> None:
    good, off = success_by_pose(PICKS)
    assert (good.successes, good.attempts, off.successes, off.attempts) == (1, 2, 1, 2)
    assert good.label == "pose within 10 deg and 5 mm" and good.share == 0.5
    # Wilson, 1 of 2: (0.5 + 0.9604) / 2.9208 -+ 1.96 * sqrt(0.125 + 0.2401) / 2.9208.
    assert good.interval == pytest.approx((0.0945, 0.9055), abs=1e-4)
