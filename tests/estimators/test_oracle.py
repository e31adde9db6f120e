"""The oracle returns the true poses, and its noise has the stated medians."""

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.estimators.oracle import OracleEstimator, PoseNoise
from simpick.geometry import Pinhole, invert, random_rotation, rotation_angle, transform
from simpick.records import CameraFrame, Detection, InstanceTruth


def make_frame(T_world_camera: np.ndarray) -> CameraFrame:
    return CameraFrame(np.zeros((4, 6, 3), np.uint8), Pinhole.from_fovy(6, 4, 30), T_world_camera)


def make_detection(instance: int | None) -> Detection:
    return Detection("tee", np.array([0.0, 0.0, 2.0, 2.0]), None, 0.9, instance)


def test_estimates_are_the_truth_in_the_camera_frame() -> None:
    rng = np.random.default_rng(0)
    T_world_camera = transform(random_rotation(rng), rng.normal(size=3))
    truth = [InstanceTruth(k, "tee", transform(random_rotation(rng), rng.normal(size=3)), True) for k in range(3)]
    estimates = OracleEstimator(lambda: truth).estimate(make_frame(T_world_camera), [make_detection(2)])
    np.testing.assert_allclose(T_world_camera @ estimates[0].T_camera_part, truth[2].T_world_part, atol=1e-12)
    assert estimates[0].detection is not None and estimates[0].detection.instance == 2


@pytest.mark.parametrize("instance", [None, 7])
def test_a_detection_of_nothing_known_gets_no_estimate(instance: int | None) -> None:
    truth = [InstanceTruth(0, "tee", np.eye(4), True)]
    assert OracleEstimator(lambda: truth).estimate(make_frame(np.eye(4)), [make_detection(instance)]) == []


def test_noise_has_the_medians_it_is_named_after() -> None:
    rng = np.random.default_rng(1)
    noise = PoseNoise(rotation_deg=5.0, translation_mm=3.0)
    T = transform(random_rotation(rng), rng.normal(size=3))
    errors = np.stack([invert(T) @ noise.apply(T, rng) for _ in range(4000)])
    assert np.median(np.degrees(rotation_angle(errors[:, :3, :3]))) == pytest.approx(5.0, rel=0.05)
    assert np.median(np.linalg.norm(errors[:, :3, 3], axis=1)) * 1e3 == pytest.approx(3.0, rel=0.05)


def test_noise_draws_as_often_when_it_is_zero() -> None:
    """So that runs with different noise see the same random directions."""
    a, b = np.random.default_rng(3), np.random.default_rng(3)
    PoseNoise().apply(np.eye(4), a)
    PoseNoise(1.0, 1.0).apply(np.eye(4), b)
    assert a.normal() == b.normal()


def test_bad_noise_is_refused() -> None:
    with pytest.raises(ConfigError, match="rotation_deg must be at least 0, got -1"):
        PoseNoise(rotation_deg=-1)
    with pytest.raises(ConfigError, match="needs a random generator"):
        OracleEstimator(tuple, PoseNoise(translation_mm=1))
