"""Coarse and fine estimation: shipped weights where accuracy is asked for, tiny untrained ones elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from simpick.assets.library import get_part
from simpick.errors import CheckpointError, ConfigError, UnknownNameError
from simpick.estimators import PoseEstimator
from simpick.estimators.raypose import (
    PRESETS,
    RayPose,
    RayPoseEstimator,
    RayPoseEstimatorConfig,
    load_raypose,
    save_checkpoint,
)
from simpick.estimators.raypose.recent_views import RecentViews
from simpick.estimators.raypose.template_bank import TemplateBank
from simpick.geometry import so3_exp, transform
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis
from simpick.rendering import load_templates
from tests.estimators.test_retrieval import CAMERA, pictures

pytestmark = pytest.mark.render
COARSE = replace(PRESETS["tiny"], spread_deg=180.0)


class Start:
    """Answers with given poses, the best first."""

    mode = "start"

    def __init__(self, Ts_camera_part: list[np.ndarray]) -> None:
        self.Ts_camera_part = Ts_camera_part

    def onboard(self, part) -> None:
        pass

    def estimate(self, frame, detections) -> list[PoseEstimate]:
        hypotheses = tuple(PoseHypothesis(T, 1.0) for T in self.Ts_camera_part)
        T = self.Ts_camera_part[0]
        return [PoseEstimate(d.part, T, 1.0, self.mode, 0.0, hypotheses, detection=d) for d in detections]


def tiny(config=PRESETS["tiny"]) -> RayPose:
    torch.manual_seed(0)
    return RayPose(config)


@pytest.fixture(scope="module")
def crank():
    return get_part("crank_arm")


@pytest.fixture(scope="module")
def coarse(crank) -> RayPoseEstimator:
    estimator = RayPoseEstimator(tiny(COARSE), RayPoseEstimatorConfig(turns=3))
    estimator.onboard(crank)
    return estimator


def off(T: np.ndarray, deg: float, rng: np.random.Generator) -> np.ndarray:
    axis = rng.normal(size=3)
    return transform(so3_exp(np.radians(deg) * axis / np.linalg.norm(axis)) @ T[:3, :3], T[:3, 3])


def test_a_fine_predictor_comes_closer_than_where_it_starts(crank):
    rng = np.random.default_rng(0)
    before, after, depth = [], [], []
    for frame, detection, T in pictures(crank, 8, seed=3):
        estimator = load_raypose("fine", start=Start([off(T, 15.0, rng)]))
        estimator.onboard(crank)
        (estimate,) = estimator.estimate(frame, [detection])
        assert estimate.detection is detection and estimate.mode == "fine" and 0 <= estimate.score <= 1
        before.append(15.0)
        after.append(np.degrees(crank.symmetries.rotation_distance(estimate.T_camera_part[:3, :3], T[:3, :3])))
        depth.append(abs(estimate.T_camera_part[2, 3] / T[2, 3] - 1))
    assert np.median(after) < 0.6 * np.median(before)
    assert np.median(depth) < 0.05


def test_a_coarse_predictor_comes_closer_with_templates_around_its_own_estimates(crank):
    errors = {}
    seen = list(pictures(crank, 8, seed=3))
    for iterations in (0, 2):
        estimator = load_raypose("coarse", RayPoseEstimatorConfig(iterations=iterations))
        estimator.onboard(crank)
        errors[iterations] = [
            np.degrees(crank.symmetries.rotation_distance(estimate.T_camera_part[:3, :3], T[:3, :3]))
            for frame, detection, T in seen
            for estimate in estimator.estimate(frame, [detection])
        ]
    assert len(errors[0]) == len(errors[2]) == 8
    assert np.median(errors[2]) < 0.7 * np.median(errors[0])


def test_the_same_image_gives_the_same_answer_alone_and_in_a_batch(coarse, crank):
    frame, detection, _ = next(iter(pictures(crank, 1)))
    other = replace_detection(detection)
    (alone,) = coarse.estimate(frame, [detection])
    first, second = coarse.estimate(frame, [other, detection])
    np.testing.assert_allclose(second.T_camera_part, alone.T_camera_part, atol=1e-4)
    assert first.detection is other and second.detection is detection
    assert isinstance(coarse, PoseEstimator)


def replace_detection(detection: Detection) -> Detection:
    assert detection.mask is not None
    mask = detection.mask.copy()
    mask[:, : int(detection.box_xyxy_px[[0, 2]].mean())] = False
    return replace(detection, mask=mask)


def test_hypotheses_are_apart_and_the_best_comes_first(crank):
    frame, detection, T = next(iter(pictures(crank, 1)))
    rng = np.random.default_rng(1)
    starts = [off(T, deg, rng) for deg in (0.0, 60.0, 120.0, 120.0)]
    estimator = RayPoseEstimator(tiny(), RayPoseEstimatorConfig(hypotheses=4), start=Start(starts))
    estimator.onboard(crank)
    (estimate,) = estimator.estimate(frame, [detection])
    scores = [h.score for h in estimate.hypotheses]
    assert 1 < len(scores) <= 4 and scores == sorted(scores, reverse=True)
    np.testing.assert_array_equal(estimate.T_camera_part, estimate.hypotheses[0].T_camera_part)


@pytest.mark.parametrize(("hypotheses", "measured"), [(1, 2), (3, 3), (9, 6)])
def test_flow_is_measured_for_the_starts_that_matches_agree_on_best(crank, monkeypatch, hypotheses, measured):
    frame, detection, T = next(iter(pictures(crank, 1)))
    rng = np.random.default_rng(1)
    starts = [off(T, deg, rng) for deg in (170.0, 150.0, 10.0, 120.0, 100.0, 90.0)]
    config = RayPoseEstimatorConfig(hypotheses=hypotheses, starts=6, views=0, kept=2)
    estimator = load_raypose("fine", config, start=Start(starts))
    estimator.onboard(crank)
    followed = []
    around = TemplateBank.around
    monkeypatch.setattr(TemplateBank, "around", lambda bank, Ts, **kw: followed.append(Ts) or around(bank, Ts, **kw))
    (estimate,) = estimator.estimate(frame, [detection])
    assert len(followed[-1]) == measured
    error_deg = np.degrees(crank.symmetries.rotation_distance(estimate.T_camera_part[:3, :3], T[:3, :3]))
    assert error_deg < 10.0


@pytest.mark.parametrize("change", [{}, {"multiview": False}, {"matching": False, "flow": False}], ids=str)
@pytest.mark.parametrize("iterations", [0, 1, 2])
def test_any_network_can_be_coarse_with_any_number_of_passes(crank, change, iterations):
    frame, detection, _ = next(iter(pictures(crank, 1)))
    config = RayPoseEstimatorConfig(turns=3, tried=2, hypotheses=2, iterations=iterations)
    estimator = RayPoseEstimator(tiny(replace(COARSE, **change)), config)
    estimator.onboard(crank)
    (estimate,) = estimator.estimate(frame, [detection])
    assert 1 <= len(estimate.hypotheses) <= 2
    assert all(0 <= h.score <= 1 and np.isfinite(h.T_camera_part).all() for h in estimate.hypotheses)


def test_many_detections_are_answered_as_each_alone(crank):
    frame, detection, T = next(iter(pictures(crank, 1)))
    rng = np.random.default_rng(2)
    starts = [off(T, deg, rng) for deg in rng.uniform(0, 40, 40)]
    config = RayPoseEstimatorConfig(hypotheses=40, cluster_deg=1e-6, cluster_diameters=1e-9)

    def answers(starts):
        # More starts than are taken at a time.
        estimator = RayPoseEstimator(tiny(), config, start=Start(starts))
        estimator.onboard(crank)
        return estimator.estimate(frame, [detection])[0].hypotheses

    together = answers(starts)
    alone = [answers([start])[0] for start in starts[::13]]
    assert len(together) > 32
    for one in alone:
        assert min(np.abs(one.T_camera_part - other.T_camera_part).max() for other in together) < 1e-3


def test_equivalent_starts_of_a_symmetric_part_give_the_same_answer():
    nut = get_part("hex_nut")
    frame, detection, T = next(iter(pictures(nut, 1)))
    answers = []
    for S in (np.eye(4), nut.symmetries.discrete[0]):
        estimator = RayPoseEstimator(tiny(), start=Start([T @ S]))
        estimator.onboard(nut)
        answers.append(estimator.estimate(frame, [detection])[0].T_camera_part)
    turned = nut.symmetries.rotation_distance(answers[0][:3, :3], answers[1][:3, :3])
    assert np.degrees(turned) < 1.0


@pytest.mark.parametrize("pixels", [0, 1, 15])
def test_too_small_a_mask_has_no_estimate(coarse, crank, pixels):
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[100, 100 : 100 + pixels] = True
    frame = CameraFrame(np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), CAMERA, np.eye(4))
    assert coarse.estimate(frame, [Detection(crank.name, np.array([100.0, 100, 115, 101]), mask, 1.0)]) == []


@pytest.mark.parametrize("box", [[-50.0, -50, -10, -10], [400.0, 10, 420, 30], [np.nan, 0, 10, 10]])
def test_a_box_outside_the_image_has_no_estimate(coarse, crank, box):
    frame = CameraFrame(np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), CAMERA, np.eye(4))
    assert coarse.estimate(frame, [Detection(crank.name, np.array(box), None, 1.0)]) == []


def test_a_part_that_was_not_onboarded_is_refused(coarse):
    frame = CameraFrame(np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), CAMERA, np.eye(4))
    with pytest.raises(UnknownNameError, match=r"no onboarded part named 'bolt'.*onboard\(part\) first"):
        coarse.estimate(frame, [Detection("bolt", np.array([0.0, 0, 50, 50]), None, 1.0)])


def test_an_image_of_floats_is_refused(coarse, crank):
    # Not-a-number pixels can only come this way. The record's own type check is off where tests are.
    frame, detection, _ = next(iter(pictures(crank, 1)))
    object.__setattr__(frame, "rgb", np.full((CAMERA.height, CAMERA.width, 3), np.nan))
    with pytest.raises(ConfigError, match=r"must have 8-bit channels \(uint8\), got float64"):
        coarse.estimate(frame, [detection])


def test_a_network_is_coarse_without_a_start_and_fine_with_one():
    assert RayPoseEstimator(tiny()).mode == RayPoseEstimator(tiny(COARSE)).mode == "coarse"
    assert RayPoseEstimator(tiny(), start=Start([])).mode == "fine"


def test_weights_of_the_other_mode_are_refused(tmp_path):
    save_checkpoint(tmp_path / "coarse.safetensors", tiny(COARSE), {})
    with pytest.raises(CheckpointError, match="must hold a fine network, got one with templates within 180 degrees"):
        load_raypose("fine", weights=tmp_path / "coarse.safetensors")


def test_settings_out_of_range_are_refused():
    for name in ("turns", "tried", "hypotheses", "min_mask_px"):
        with pytest.raises(ConfigError, match=f"{name} must be (at least 1|between 1 and 64), got 0"):
            RayPoseEstimatorConfig(**{name: 0})
    with pytest.raises(ConfigError, match="a fine network needs starts or views to follow, got 0 of both"):
        RayPoseEstimatorConfig(starts=0, views=0)
    with pytest.raises(ConfigError, match="iterations must be at least 0, got -1"):
        RayPoseEstimatorConfig(iterations=-1)
    with pytest.raises(ConfigError, match="a fine network needs 1 iteration or more, got 0"):
        RayPoseEstimator(tiny(), RayPoseEstimatorConfig(iterations=0), start=Start([]))
    with pytest.raises(ConfigError, match="hypotheses must be between 1 and 64, got 65"):
        RayPoseEstimatorConfig(hypotheses=65)


def test_a_bank_that_keeps_few_templates_gives_the_same_ones(crank):
    Ts = [transform(so3_exp(np.array([0.0, 0.4 * k, 0.3 * k])), np.array([0.0, 0.0, 0.5])) for k in range(6)]
    model, templates = tiny().eval(), load_templates(crank)
    all_views, few_views = RecentViews(), RecentViews(max_bytes=0)
    everything = TemplateBank(model, crank, templates, all_views)
    with torch.inference_mode():
        expected = [everything.around(T[None]).descriptors for T in Ts]
        few_views.max_bytes = 10 * all_views.bytes // len(all_views)
        few = TemplateBank(model, crank, templates, few_views)
        for T, descriptors in zip(Ts * 2, expected * 2, strict=True):
            torch.testing.assert_close(few.around(T[None]).descriptors, descriptors, atol=1e-4, rtol=0)
            assert len(few_views) <= 10 < len(all_views)
