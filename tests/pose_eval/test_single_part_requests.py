"""Requests for one part in bins of others, judged from answers that are known."""

import numpy as np
import pytest

from simpick.geometry import Pinhole, box_of_mask
from simpick.pose_eval.benchmark_bins import benchmark_bins
from simpick.pose_eval.bin_images import BinView
from simpick.pose_eval.pose_images import PoseTruth
from simpick.pose_eval.single_part_requests import answer_intervals, answers_table, judge_answer
from simpick.records import CameraFrame, Detection

MIXED, HOMOGENEOUS = benchmark_bins(5)[0], benchmark_bins(5)[3]


@pytest.fixture
def view() -> BinView:
    ids = np.full((60, 80), -1, np.int32)
    ids[10:40, 5:25], ids[10:40, 30:50] = 0, 1
    frame = CameraFrame(np.zeros((60, 80, 3), np.uint8), Pinhole.from_fovy(80, 60, 30.0), np.eye(4), None, ids)
    truths = (PoseTruth("hex_bolt", np.eye(4), 1.0, 0), PoseTruth("hex_nut", np.eye(4), 0.2, 1))
    return BinView(1, frame, (), truths, ())


def detection(view: BinView, instance: int, part: str, score: float) -> Detection:
    mask = view.frame.instances == instance
    return Detection(part, box_of_mask(mask), mask, score)


def test_a_part_that_is_there_is_found_by_its_own_mask_alone(view: BinView) -> None:
    right = judge_answer(MIXED, view, "hex_bolt", [detection(view, 0, "hex_bolt", 0.7)])
    assert (right.is_held, right.found, right.visible, right.answers, right.highest_score) == (True, 1, 1, 1, 0.7)
    wrong = judge_answer(MIXED, view, "hex_bolt", [detection(view, 1, "hex_bolt", 0.7)])
    assert wrong.is_held and wrong.found == 0


@pytest.mark.parametrize("part", ["pipe_tee", "hex_nut"])
def test_a_part_that_is_absent_or_hidden_is_not_held(view: BinView, part: str) -> None:
    answer = judge_answer(MIXED, view, part, [])
    assert not answer.is_held and answer.answers == 0 and answer.highest_score == 0


def test_figures_are_shares_of_requests_and_of_instances(view: BinView) -> None:
    some = [detection(view, 0, "pipe_tee", 0.6), detection(view, 1, "pipe_tee", 0.3)]
    answers = [
        judge_answer(MIXED, view, "pipe_tee", some),
        judge_answer(MIXED, view, "pipe_tee", some[1:]),
        judge_answer(MIXED, view, "pipe_tee", []),
        judge_answer(HOMOGENEOUS, view, "pipe_tee", []),
    ]
    figures = answer_intervals(answers)
    assert figures["empty answers [%]"].value == pytest.approx(50)
    assert figures["highest score below 0.5 [%]"].value == pytest.approx(75)
    assert figures["detections"].value == pytest.approx(0.75)
    assert np.isnan(figures["found [%]"].value)
    headings = [str(column.header) for column in answers_table(answers).columns]
    assert headings == ["", "absent, mixed (3 requests)", "absent, homogeneous (1 requests)"]
