"""VSD on images of a few pixels, worked out by hand, and against a pixel-by-pixel loop."""

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.geometry import Pinhole
from simpick.metrics import distance_from_depth, visible_mask, vsd
from simpick.metrics.visible_surface import VSD_TAUS

# So long a lens that distance and depth are the same number.
STRIP = Pinhole(8, 1, 1e9, 1e9, 4.0, 0.5)


def strip(*values: float) -> np.ndarray:
    return np.array([values], float)


def strip_vsd(estimate: np.ndarray, truth: np.ndarray, scene: np.ndarray, **options) -> np.ndarray:
    return vsd(estimate[None], truth[None], scene, STRIP, 0.1, **options)[0, 0]


def test_distance_grows_towards_the_edge_of_the_image() -> None:
    camera = Pinhole(201, 1, 100.0, 100.0, 100.5, 0.5)
    distance = distance_from_depth(np.full((1, 201), 4.0), camera)
    # Pixel 175's centre is 75 px right of the axis: a 3-4-5 triangle.
    assert distance[0, 100] == pytest.approx(4)
    assert distance[0, 175] == pytest.approx(5)


def test_distance_keeps_missing_readings() -> None:
    assert not distance_from_depth(np.zeros((2, 1, 8), np.float32), STRIP).any()


def test_a_part_is_visible_in_front_of_the_scene_within_delta_of_it_and_where_the_scene_is_unknown() -> None:
    model = np.array([1.000, 1.000, 1.000, 1.0, 0.0])
    scene = np.array([2.000, 0.990, 0.980, 0.0, 1.0])
    np.testing.assert_array_equal(visible_mask(model, scene), [True, True, False, True, False])


def test_half_overlap_by_hand() -> None:
    truth = strip(1, 1, 1, 1, 1, 1, 0, 0)
    estimate = 1.012 * strip(0, 0, 1, 1, 1, 1, 1, 1)
    scene = strip(1, 1, 1, 1, 1, 1, 2, 2)
    # Union 8 px, intersection 4 px, 0.12 diameters apart there: wrong at tau 0.05 and 0.10 only.
    np.testing.assert_allclose(strip_vsd(estimate, truth, scene), [1, 1] + 8 * [0.5])


def test_equal_poses_have_no_error() -> None:
    truth = strip(1, 1, 1, 0, 0, 0, 0, 0)
    assert not strip_vsd(truth, truth, truth).any()


def test_a_distance_equal_to_the_tolerance_is_an_error() -> None:
    truth, estimate = strip(1, 1, 1, 1, 1, 1, 1, 1), 1.25 * strip(1, 1, 1, 1, 1, 1, 1, 1)
    errors = vsd(estimate[None], truth[None], truth, STRIP, 1.0, taus=np.array([0.125, 0.25, 0.5]))
    np.testing.assert_array_equal(errors[0, 0], [1, 1, 0])


def test_an_estimate_behind_the_surface_is_visible_where_the_truth_is() -> None:
    truth = strip(1, 1, 1, 1, 0, 0, 0, 0)
    scene = strip(1, 1, 1, 1, 0.9, 0.9, 0.9, 0.9)
    # 30 mm too far: hidden by the neighbour on the right (out of the union), but not by itself on the left.
    estimate = 1.03 * strip(0, 0, 1, 1, 1, 1, 0, 0)
    np.testing.assert_allclose(strip_vsd(estimate, truth, scene), 6 * [1] + 4 * [0.5])


def test_an_occluded_truth_leaves_the_union() -> None:
    truth = strip(1, 1, 1, 1, 0, 0, 0, 0)
    scene = strip(1, 1, 0.5, 0.5, 2, 2, 2, 2)
    estimate = strip(1, 0, 1, 1, 0, 0, 0, 0)
    np.testing.assert_allclose(strip_vsd(estimate, truth, scene), 10 * [0.5])


def test_where_nothing_is_seen_the_error_is_one() -> None:
    hidden = strip(1, 1, 1, 1, 0, 0, 0, 0)
    np.testing.assert_array_equal(strip_vsd(hidden, hidden, 0.5 * strip(1, 1, 1, 1, 1, 1, 1, 1)), np.ones(10))


def test_delta_decides_what_is_hidden() -> None:
    truth, scene = strip(1, 1, 0, 0, 0, 0, 0, 0), strip(0.99, 0.99, 2, 2, 2, 2, 2, 2)
    assert not strip_vsd(truth, truth, scene).any()
    assert strip_vsd(truth, truth, scene, delta_m=0.005).all()


def test_pairs_that_are_no_candidates_get_one() -> None:
    truth = strip(1, 1, 1, 0, 0, 0, 0, 0)
    assert strip_vsd(truth, truth, truth, candidates=np.array([[False]])).all()


def loop_vsd(estimate: np.ndarray, truth: np.ndarray, scene: np.ndarray, diameter: float, tau: float) -> float:
    cost, union = 0, 0
    for e, t, s in zip(estimate.ravel(), truth.ravel(), scene.ravel(), strict=True):
        truth_seen = t > 0 and (s == 0 or t <= s + 0.015)
        estimate_seen = e > 0 and (s == 0 or e <= s + 0.015 or truth_seen)
        if truth_seen or estimate_seen:
            union += 1
            cost += not (truth_seen and estimate_seen) or abs(e - t) / diameter >= tau
    return cost / union if union else 1.0


def test_tables_agree_with_a_loop_over_pixels() -> None:
    rng = np.random.default_rng(0)
    camera = Pinhole(20, 15, 18.0, 19.0, 9.0, 8.0)

    def depths(n: int) -> np.ndarray:
        return (rng.uniform(0.9, 1.1, (n, 15, 20)) * (rng.random((n, 15, 20)) < 0.7)).astype(np.float32)

    estimates, truths, scene = depths(3), depths(2), depths(1)[0]
    errors = vsd(estimates, truths, scene, camera, 0.3)
    assert errors.shape == (3, 2, 10)
    d_e, d_t, d_s = (distance_from_depth(d, camera) for d in (estimates, truths, scene))
    for e in range(3):
        for g in range(2):
            expected = [loop_vsd(d_e[e], d_t[g], d_s, 0.3, tau) for tau in VSD_TAUS]
            np.testing.assert_allclose(errors[e, g], expected)


def test_no_estimates_give_an_empty_table() -> None:
    assert vsd(np.zeros((0, 1, 8)), np.ones((2, 1, 8)), np.ones((1, 8)), STRIP, 0.1).shape == (0, 2, 10)


def test_depth_of_another_size_is_refused() -> None:
    with pytest.raises(ConfigError, match="depth must be 8 x 1 px like its camera, got 4 x 1; render it"):
        distance_from_depth(np.ones((1, 4)), STRIP)
