"""The best of K hypotheses has the least rotation error over symmetries."""

import numpy as np

from simpick.geometry import Pinhole, so3_exp, transform
from simpick.pose_eval.best_of import best_of
from simpick.pose_eval.pose_images import PoseImage, PoseTruth, library_model
from simpick.pose_eval.pose_sources import Answer
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis

FRAME = CameraFrame(np.zeros((8, 8, 3), np.uint8), Pinhole(8, 8, 8.0, 8.0, 4.0, 4.0), np.eye(4))


def rotated(deg: float, axis: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> np.ndarray:
    return transform(so3_exp(np.radians(deg) * np.array(axis)), np.array([0.0, 0.0, 1.0]))


def answer(part: str, Ts: list[np.ndarray], k: int, instance: int | None = 3) -> np.ndarray:
    image = PoseImage(0, 0, FRAME, (), (PoseTruth(part, rotated(0), 1.0, 3),), {part: 1})
    detection = Detection(part, np.array([0.0, 0.0, 8.0, 8.0]), None, 1.0, instance)
    hypotheses = tuple(PoseHypothesis(T, 1.0) for T in Ts)
    estimate = PoseEstimate(part, rotated(77), 0.5, "test", 0.0, hypotheses, detection)
    (chosen,) = best_of(Answer(image, [estimate], 0.0), k, library_model)
    assert chosen.score == 0.5
    return chosen.T_camera_part


def test_only_the_first_k_are_offered() -> None:
    Ts = [rotated(30), rotated(-20), rotated(10), rotated(1)]
    for k, best in [(1, 0), (2, 1), (3, 2), (50, 3)]:
        np.testing.assert_array_equal(answer("connecting_rod", Ts, k), Ts[best])


def test_a_symmetry_is_no_error() -> None:
    # A sixth of a turn about its axis leaves a hexagonal nut as it was.
    Ts = [rotated(5), rotated(60, (0.0, 0.0, 1.0))]
    np.testing.assert_array_equal(answer("hex_nut", Ts, 2), Ts[1])


def test_estimates_that_cannot_be_improved_stay() -> None:
    np.testing.assert_array_equal(answer("hex_nut", [], 5), rotated(77))
    np.testing.assert_array_equal(answer("hex_nut", [rotated(1)], 5, instance=None), rotated(77))
