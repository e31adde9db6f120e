"""The detector benchmark: overlaps, names and intervals, from a bin whose detections are known."""

import numpy as np
import pytest

from simpick.activity import current_activity
from simpick.geometry import Pinhole, box_of_mask
from simpick.pose_eval.benchmark_bins import benchmark_bins
from simpick.pose_eval.bin_images import BinView
from simpick.pose_eval.detector_benchmark import compare_bin, detect_bins, detection_intervals, figures_table
from simpick.pose_eval.pose_images import PoseTruth
from simpick.records import CameraFrame, Detection

NAMES = ("hex_bolt", "pipe_tee", "hex_nut")


@pytest.fixture
def view() -> BinView:
    ids = np.full((60, 80), -1, np.int32)
    for k in range(3):
        ids[10:40, 5 + 25 * k : 25 + 25 * k] = k
    frame = CameraFrame(np.zeros((60, 80, 3), np.uint8), Pinhole.from_fovy(80, 60, 30.0), np.eye(4), None, ids)
    truths = tuple(
        PoseTruth(name, np.eye(4), fraction, k)
        for k, (name, fraction) in enumerate(zip(NAMES, (1.0, 0.6, 0.1), strict=True))
    )
    return BinView(1, frame, (), truths, ())


def detection(view: BinView, instance: int, name: str, *, has_mask: bool = True) -> Detection:
    mask = view.frame.instances == instance
    return Detection(name, box_of_mask(mask), mask if has_mask else None, 0.9)


def test_right_masks_and_names_are_counted(view: BinView) -> None:
    found = compare_bin(benchmark_bins(1)[0], view, [detection(view, 0, "hex_bolt"), detection(view, 1, "hex_nut")])
    figures = detection_intervals([found])
    assert figures["ap50"].value == figures["recall"].value == pytest.approx(100)
    assert figures["named right"].value == pytest.approx(50)
    assert figures["found, 50% to 70% visible"].value == pytest.approx(100)


def test_a_detection_without_mask_covers_its_box(view: BinView) -> None:
    found = compare_bin(benchmark_bins(1)[0], view, [detection(view, 0, "hex_bolt", has_mask=False)])
    assert found.overlaps.iou[0, 0] == pytest.approx(1)
    assert detection_intervals([found])["recall"].value == pytest.approx(50)


def test_the_table_has_a_column_for_each_kind_of_bin(view: BinView) -> None:
    bins = benchmark_bins(5)
    found = [compare_bin(bin, view, [detection(view, 0, "hex_bolt")]) for bin in (bins[0], bins[3])]
    table = figures_table(found)
    assert [str(column.header) for column in table.columns] == [
        "",
        "all (2 bins)",
        "mixed (1 bins)",
        "homogeneous (1 bins)",
    ]


def test_parts_are_prepared_before_the_time_counts_and_it_is_stated_how_many(
    view: BinView, monkeypatch: pytest.MonkeyPatch
) -> None:
    stated = []

    class Prepares:
        def onboard(self, part) -> None:
            stated.append(current_activity())

        def detect(self, frame, parts) -> list[Detection]:
            stated.append("detect")
            return []

    bin = benchmark_bins(1)[0]
    monkeypatch.setattr("simpick.pose_eval.detector_benchmark.load_view", lambda _: view)
    detect_bins(Prepares, [bin])
    count = len(bin.config.parts)
    assert stated[:count] == [f"preparing part {k}/{count}" for k in range(1, count + 1)]
    assert set(stated[count:]) == {"detect"}
