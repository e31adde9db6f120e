"""Perception moves estimates from images until the parts rest; the oracle's poses stay as they are."""

from collections.abc import Sequence

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.estimators.oracle import OracleEstimator
from simpick.geometry import Pinhole, invert, look_at, transform
from simpick.policies import Perception
from simpick.records import CameraFrame, Detection, InstanceTruth, PoseEstimate, PoseHypothesis

NUT = get_part("hex_nut")
T_WORLD_CAMERA = look_at(np.array([0.5, 0.0, 0.9]), np.array([0.5, 0.0, 0.0]))
FRAME = CameraFrame(np.zeros((24, 32, 3), np.uint8), Pinhole(32, 24, 48.0, 48.0, 16.0, 12.0), T_WORLD_CAMERA)
SUNK = transform(translation=np.array([0.5, 0.0, -0.012]))
"""A nut, 16 mm high, whose underside is 20 mm below the floor."""


class OneNut:
    """Detects one nut, and estimates it 20 mm too far away."""

    def detect(self, frame: CameraFrame, parts: Sequence) -> list[Detection]:
        return [Detection(NUT.name, np.array([8.0, 8.0, 24.0, 16.0]), None, 1.0, instance=0)]

    def onboard(self, part) -> None:
        pass

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        T = invert(T_WORLD_CAMERA) @ SUNK
        return [PoseEstimate(NUT.name, T, 0.8, "sunk", 0.0, (PoseHypothesis(T, 0.8),), d) for d in detections]


def test_estimates_rest_on_the_floor_and_lose_score() -> None:
    percept = Perception("sunk", OneNut(), OneNut()).perceive(FRAME, [NUT])
    (estimate,) = percept.estimates
    for T in (estimate.T_camera_part, estimate.hypotheses[0].T_camera_part):
        assert (T_WORLD_CAMERA @ T)[2, 3] == pytest.approx(0.008, abs=1e-6)
    assert estimate.score == pytest.approx(0.8 / np.e)
    assert estimate.detection is percept.detections[0]


def test_the_oracle_s_poses_stay() -> None:
    truth = InstanceTruth(0, NUT.name, SUNK, True)
    (estimate,) = Perception("oracle", OneNut(), OracleEstimator(lambda: [truth])).perceive(FRAME, [NUT]).estimates
    np.testing.assert_allclose(T_WORLD_CAMERA @ estimate.T_camera_part, SUNK, atol=1e-12)
    assert estimate.score == 1.0


class Segments(OneNut):
    def foreground(self, frame: CameraFrame) -> np.ndarray:
        return frame.rgb[..., 0] == 0


def test_the_foreground_is_kept_where_the_detector_knows_it() -> None:
    assert Perception("x", OneNut(), OneNut()).perceive(FRAME, [NUT]).foreground is None
    own = Perception("x", Segments(), OneNut()).perceive(FRAME, [NUT]).foreground
    other = Perception("x", OneNut(), OneNut(), foreground=Segments()).perceive(FRAME, [NUT]).foreground
    assert own is not None and other is not None and own.all() and other.all()


class Sized(OneNut):
    min_visible_px = 40


def test_what_the_detector_needs_to_see_is_kept() -> None:
    assert Perception("x", OneNut(), OneNut()).perceive(FRAME, [NUT]).needed_px is None
    assert Perception("x", Sized(), OneNut()).perceive(FRAME, [NUT]).needed_px == 40
