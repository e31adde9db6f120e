"""Average recalls by hand: several identical parts in one image, targets and top estimates, pooling."""

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.geometry import Pinhole, SymmetryGroup, transform
from simpick.metrics import DepthImages, EvaluationModel, TargetErrors, average_recalls, pose_scores, target_errors

CAMERA = Pinhole(640, 480, 500.0, 500.0, 320.0, 240.0)
CORNERS = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.04, 0.04) for z in (0.0, 0.0)])
# A plate whose diameter is 0.1 m, so that 1 mm are 0.01 diameters; at 1 m, 2 mm are 1 px.
PLATE = EvaluationModel("plate", CORNERS, 0.1, SymmetryGroup())


def at(*positions_mm: tuple[float, float]) -> np.ndarray:
    """Return poses 1 m before the camera, at these offsets."""
    xy = np.array(positions_mm, float).reshape(-1, 2) / 1000
    return transform(np.eye(3), np.concatenate([xy, np.ones((len(xy), 1))], 1)).reshape(-1, 4, 4)


def errors_of(estimates: np.ndarray, truths: np.ndarray, inst_count: int, **options) -> TargetErrors:
    scores = options.get("scores", np.linspace(1, 0.5, len(estimates)))
    visible = options.get("visible", np.ones(len(truths)))
    camera = options.get("camera", CAMERA)
    return target_errors(PLATE, camera, estimates, scores, truths, visible, inst_count, options.get("depth"))


def test_three_identical_parts_by_hand() -> None:
    truths = at((0, 0), (200, 0), (0, 200))
    # 12 mm, 31 mm and 3 mm off: MSSD 0.12, 0.31, 0.03 diameters and MSPD 6, 15.5, 1.5 px.
    estimates = at((200, 12), (31, 0), (3, 200))
    target = errors_of(estimates, truths, 3)
    assert target.targets == 3
    np.testing.assert_allclose(target.mssd[[0, 1, 2], [1, 0, 2]], [0.12, 0.31, 0.03])
    np.testing.assert_allclose(target.mspd_px[[0, 1, 2], [1, 0, 2]], [6, 15.5, 1.5])
    recalls = average_recalls([target])
    np.testing.assert_allclose(3 * recalls.recalls_mssd, [1, 1, 2, 2, 2, 2, 3, 3, 3, 3])
    np.testing.assert_allclose(3 * recalls.recalls_mspd, [1, 2, 2, 3, 3, 3, 3, 3, 3, 3])
    assert recalls.ar_mssd == pytest.approx(22 / 30)
    assert recalls.ar_mspd == pytest.approx(26 / 30)
    assert recalls.ar_vsd is None and recalls.ar is None


def test_two_estimates_of_one_instance_find_one() -> None:
    target = errors_of(at((0, 0), (1, 0)), at((0, 0), (200, 0)), 2)
    np.testing.assert_allclose(average_recalls([target]).recalls_mssd, 0.5)


def test_only_the_highest_scores_count() -> None:
    truths, estimates = at((0, 0), (200, 0)), at((0, 0), (500, 0), (200, 0))
    # The right answer for the second instance ranks third, and two instances were asked for.
    assert average_recalls([errors_of(estimates, truths, 2)]).ar_mssd == pytest.approx(0.5)
    reranked = errors_of(estimates, truths, 2, scores=np.array([0.9, 0.1, 0.8]))
    assert average_recalls([reranked]).ar_mssd == pytest.approx(1)


def test_only_the_most_visible_truths_count() -> None:
    truths = at((0, 0), (200, 0), (0, 200))
    # An estimate of the hidden instance neither earns a target nor finds one.
    target = errors_of(at((200, 0), (0, 0)), truths, 2, visible=np.array([0.6, 0.05, 0.4]))
    assert target.targets == 2
    assert average_recalls([target]).ar_mssd == pytest.approx(0.5)


def test_pixels_are_scaled_to_an_image_640_wide() -> None:
    wide = Pinhole(1280, 960, 1000.0, 1000.0, 640.0, 480.0)
    narrow, scaled = (errors_of(at((12, 0)), at((0, 0)), 1, camera=c).mspd_px for c in (CAMERA, wide))
    np.testing.assert_allclose(scaled, narrow)


def test_mssd_is_infinite_where_bounding_spheres_part() -> None:
    assert errors_of(at((101, 0)), at((0, 0)), 1).mssd[0, 0] == np.inf
    assert errors_of(at((99, 0)), at((0, 0)), 1).mssd[0, 0] == pytest.approx(0.99)


def test_recalls_are_pooled_over_targets_in_all_and_means_per_part() -> None:
    found = TargetErrors("bolt", np.zeros((1, 1)), np.zeros((1, 1)), None)
    missed = TargetErrors("nut", np.zeros((0, 3)), np.zeros((0, 3)), None)
    scores = pose_scores([missed, found])
    assert list(scores.by_part) == ["bolt", "nut"]
    assert scores.overall.targets == 4
    assert scores.overall.ar_mssd == pytest.approx(0.25)
    assert (scores.by_part["bolt"].ar_mspd, scores.by_part["nut"].ar_mspd) == (1, 0)


def test_ar_is_the_mean_of_its_three_terms() -> None:
    # VSD 0.22 at tolerances below 0.2 diameters and 0 above: recall 0.6 at three of ten tolerances, else 1.
    vsd = np.where(np.arange(10) < 3, 0.22, 0.0).reshape(1, 1, 10)
    recalls = average_recalls([TargetErrors("bolt", np.full((1, 1), 0.31), np.full((1, 1), 15.5), vsd)])
    assert recalls.ar_vsd == pytest.approx((3 * 0.6 + 7) / 10)
    assert recalls.ar_mssd == pytest.approx(0.4)
    assert recalls.ar_mspd == pytest.approx(0.7)
    assert recalls.ar == pytest.approx((0.88 + 0.4 + 0.7) / 3)


def test_depth_images_follow_the_estimates_and_truths_that_count() -> None:
    camera = Pinhole(4, 1, 500.0, 500.0, 2.0, 0.5)
    left, right, nothing = np.array([[1.0, 1, 0, 0]]), np.array([[0, 0, 1.0, 1]]), np.zeros((1, 4))
    depth = DepthImages(np.ones((1, 4)), np.stack([nothing, right, left]), np.stack([nothing, left, right]))
    poses = at((0, 0), (1, 0), (2, 0))
    target = errors_of(
        poses, poses, 2, camera=camera, depth=depth, scores=np.array([0.1, 0.8, 0.9]), visible=np.array([0.0, 0.5, 0.9])
    )
    assert target.vsd is not None
    # Rows: left, then right (highest score first); columns: left, right.
    np.testing.assert_array_equal(target.vsd[..., 0], [[0, 1], [1, 0]])


def test_an_image_without_estimates_or_truths_counts_its_targets() -> None:
    nothing = np.zeros((0, 4, 4))
    assert errors_of(nothing, at((0, 0), (200, 0)), 2).targets == 2
    assert errors_of(at((0, 0)), nothing, 1).targets == 0
    assert average_recalls([]).ar_mssd == 0


def test_targets_with_and_without_vsd_do_not_mix() -> None:
    one = np.zeros((1, 1))
    with pytest.raises(ConfigError, match="VSD must be computed for all targets or for none, got it for 1 of 2"):
        average_recalls([TargetErrors("a", one, one, None), TargetErrors("a", one, one, np.zeros((1, 1, 10)))])


def test_lists_must_match() -> None:
    with pytest.raises(ConfigError, match="as many visible fractions as poses, got 1 for 2"):
        errors_of(at((0, 0)), at((0, 0), (1, 0)), 1, visible=np.ones(1))


def test_the_tolerance_of_visibility_is_the_depth_images_own() -> None:
    part = np.full((1, 480, 640), 1.0)
    for delta_m, error in ((0.015, 1.0), (0.03, 0.0)):
        depth = DepthImages(np.full((480, 640), 0.98), part, part, delta_m)
        target = errors_of(at((0, 0)), at((0, 0)), 1, depth=depth)
        assert target.vsd is not None and (target.vsd == error).all(), "20 mm behind the scene"


def test_parts_whose_images_cannot_overlap_have_nothing_in_common() -> None:
    part = np.full((1, 480, 640), 1.0)
    for offset_mm, error in ((99, 0.0), (101, 1.0)):
        target = errors_of(at((offset_mm, 0)), at((0, 0)), 1, depth=DepthImages(part[0], part, part))
        assert target.vsd is not None and (target.vsd == error).all(), "their depth images are the same"
