from collections.abc import Iterator

import numpy as np
import pytest
import torch

from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators import PoseEstimator
from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator, template_index
from simpick.estimators.retrieval.descriptors import CROP_PX, describe
from simpick.geometry import Pinhole, box_of_mask, random_rotation, rotated_boxes, transform
from simpick.records import CameraFrame, Detection
from simpick.rendering import TemplateConfig, load_templates, render_part_views

CAMERA = Pinhole(320, 240, 620.0, 620.0, 150.0, 130.0)
COARSE = RetrievalConfig(views=42, turns=24)


@pytest.fixture(scope="module")
def crank():
    return get_part("crank_arm")


@pytest.fixture(scope="module")
def estimator(crank) -> RetrievalEstimator:
    estimator = RetrievalEstimator(COARSE)
    estimator.onboard(crank)
    return estimator


def pictures(part: Part, n: int, seed: int = 0) -> Iterator[tuple[CameraFrame, Detection, np.ndarray]]:
    """Frames of one part each, off the image's centre, with its detection and true pose."""
    rng = np.random.default_rng(seed)
    offsets = rng.uniform([-0.12, -0.08, 0.7], [0.12, 0.08, 0.9], (n, 3))
    Ts_camera_part = transform(random_rotation(rng, (n,)), offsets)
    views = render_part_views(part, Ts_camera_part, CAMERA)
    assert views.rgb is not None
    for rgb, mask, T in zip(views.rgb, views.masks, Ts_camera_part, strict=True):
        yield CameraFrame(rgb, CAMERA, np.eye(4)), Detection(part.name, box_of_mask(mask), mask, 1.0), T


@pytest.mark.render
def test_poses_of_a_part_alone_are_close_to_the_truth(estimator, crank):
    angles, sideways, depth = [], [], []
    for frame, detection, T in pictures(crank, 12):
        (estimate,) = estimator.estimate(frame, [detection])
        assert estimate.detection is detection and estimate.mode == "retrieval"
        angles.append(np.degrees(crank.symmetries.rotation_distance(estimate.T_camera_part[:3, :3], T[:3, :3])))
        offset = estimate.T_camera_part[:3, 3] - T[:3, 3]
        depth.append(abs(offset[2]) / T[2, 3])
        sideways.append(np.linalg.norm(offset - T[:3, 3] * offset[2] / T[2, 3]))
    # Views are 32 degrees apart here.
    assert np.median(angles) < 14
    assert np.median(depth) < 0.03
    assert np.median(sideways) < 0.003


@pytest.mark.render
def test_a_batch_gives_what_single_detections_give(estimator, crank):
    (frame, detection, _), *_ = pictures(crank, 1)
    assert detection.mask is not None
    other = Detection(crank.name, detection.box_xyxy_px, np.roll(detection.mask, 15, axis=1), 0.5)
    batch = estimator.estimate(frame, [detection, other])
    for single, together in zip([detection, other], batch, strict=True):
        (alone,) = estimator.estimate(frame, [single])
        np.testing.assert_allclose(alone.T_camera_part, together.T_camera_part, atol=1e-4)


@pytest.mark.render
def test_hypotheses_are_best_first_and_keep_their_distance(estimator, crank):
    (frame, detection, _), *_ = pictures(crank, 1)
    (estimate,) = estimator.estimate(frame, [detection])
    scores = [h.score for h in estimate.hypotheses]
    assert len(scores) == COARSE.hypotheses and scores == sorted(scores, reverse=True)
    np.testing.assert_array_equal(estimate.hypotheses[0].T_camera_part, estimate.T_camera_part)
    assert 0 <= scores[-1] < scores[0] <= 1.0001


@pytest.mark.render
@pytest.mark.parametrize("name", ["hex_nut", "bushing"])
def test_hypotheses_of_a_symmetric_part_do_not_repeat_one_look(name):
    part = get_part(name)
    assert not part.symmetries.is_trivial
    estimator = RetrievalEstimator(RetrievalConfig(views=42, turns=24, smoothing_deg=0.0))
    estimator.onboard(part)
    (frame, detection, _), *_ = pictures(part, 1, seed=3)
    (estimate,) = estimator.estimate(frame, [detection])
    Rs = np.stack([h.T_camera_part[:3, :3] for h in estimate.hypotheses])
    apart = np.degrees(part.symmetries.rotation_distance(Rs[:, None], Rs[None]))
    assert apart[~np.eye(len(Rs), dtype=bool)].min() > 14.9


@pytest.mark.render
def test_what_cannot_be_answered_has_no_estimate(estimator, crank):
    (frame, good, _), *_ = pictures(crank, 1)
    empty = np.zeros_like(good.mask)
    one, line = empty.copy(), empty.copy()
    one[5, 5] = True
    line[5, 5:80] = True
    bad = [
        Detection(crank.name, np.array([0.0, 0.0, 9.0, 9.0]), empty, 1.0),
        Detection(crank.name, np.array([5.0, 5.0, 6.0, 6.0]), one, 1.0),
        Detection(crank.name, np.array([5.0, 5.0, 80.0, 6.0]), line, 1.0),
        Detection(crank.name, np.array([900.0, 900.0, 950.0, 950.0]), None, 1.0),
        Detection(crank.name, np.array([np.nan, 0.0, 9.0, 9.0]), None, 1.0),
        Detection(crank.name, np.array([50.0, 50.0, 20.0, 20.0]), None, 1.0),
    ]
    answered = estimator.estimate(frame, [*bad, good])
    assert [e.detection for e in answered] == [good]
    assert estimator.estimate(frame, bad) == [] and estimator.estimate(frame, []) == []


@pytest.mark.render
def test_a_box_without_a_mask_is_answered(estimator, crank):
    (frame, good, T), *_ = pictures(crank, 1)
    (estimate,) = estimator.estimate(frame, [Detection(crank.name, good.box_xyxy_px, None, 1.0)])
    assert np.linalg.norm(estimate.T_camera_part[:3, 3] - T[:3, 3]) < 0.1


@pytest.mark.render
def test_wrong_input_is_explained(estimator, crank):
    (frame, good, _), *_ = pictures(crank, 1)
    assert isinstance(estimator, PoseEstimator) and good.mask is not None
    with pytest.raises(UnknownNameError, match=r"no onboarded part named 'nut'. Valid: crank_arm. Call onboard"):
        estimator.estimate(frame, [Detection("nut", good.box_xyxy_px, good.mask, 1.0)])
    with pytest.raises(ConfigError, match=r"mask must have the image's size 320 x 240 px, got 100 x 240"):
        estimator.estimate(frame, [Detection(crank.name, good.box_xyxy_px, good.mask[:, :100], 1.0)])
    with pytest.raises(ConfigError, match=r"turns must be between 4 and 360, got 1"):
        RetrievalConfig(turns=1)
    with pytest.raises(ConfigError, match=r"views must be one of 12, 42, 162, 642, 2562, got 7"):
        RetrievalConfig(views=7)


@pytest.mark.render
def test_descriptors_are_kept_and_made_again_when_damaged(crank, tmp_path, monkeypatch):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path))
    config = TemplateConfig(views=12)
    first = template_index.load_index(crank, config, 6)
    with monkeypatch.context() as patch:
        patch.setattr(template_index, "describe", lambda *a: pytest.fail("described again"))
        again = template_index.load_index(crank, config, 6)
    assert torch.equal(first.descriptors, again.descriptors)
    (path,) = (tmp_path / "retrieval").iterdir()
    path.write_bytes(path.read_bytes()[:1000])
    assert torch.equal(first.descriptors, template_index.load_index(crank, config, 6).descriptors)


@pytest.mark.render
def test_boxes_of_turned_silhouettes_enclose_the_turned_images(crank):
    templates = load_templates(crank, TemplateConfig(views=42))
    angles = np.radians([0.0, 35.0, 200.0])
    boxes = rotated_boxes(templates.masks, np.tile(angles, (len(templates), 1)))
    for view in (0, 11, 25):
        _, masks, _ = templates.turned(np.full(3, view), angles)
        for mask, box in zip(masks, boxes[view], strict=True):
            assert np.abs(box_of_mask(mask) - box).max() < 1.5


def test_descriptors_ignore_the_background_and_which_side_is_light():
    rng = np.random.default_rng(0)
    gray = torch.tensor(rng.random((1, CROP_PX, CROP_PX)), dtype=torch.float32)
    mask = torch.zeros(1, CROP_PX, CROP_PX, dtype=torch.bool)
    mask[:, 12:50, 20:56] = True
    plain = describe(gray, mask)
    assert float((plain * plain).sum()) == pytest.approx(1.0, abs=1e-5)
    torch.testing.assert_close(describe(torch.where(mask, gray, 0.9), mask), plain)
    torch.testing.assert_close(describe(1 - gray, mask), plain, atol=1e-4, rtol=0)
    torch.testing.assert_close(describe(0.3 * gray, mask), plain, atol=1e-4, rtol=0)
    assert float((describe(gray.mT, mask) * plain).sum()) < 0.98
    assert describe(torch.zeros_like(gray), torch.zeros_like(mask)).isfinite().all()
