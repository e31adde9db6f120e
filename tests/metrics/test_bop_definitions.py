"""One small scene scored from poses and depth to AR, by hand, after the definitions of the BOP Challenge."""

import numpy as np
import pytest

from simpick.geometry import Pinhole, SymmetryGroup, transform
from simpick.metrics import DepthImages, EvaluationModel, TargetErrors, average_recalls, target_errors

# A plate of 60 x 80 mm, diameter 100 mm. The image is one row of 8 pixels, 20 mm wide each at 1 m; f is 50 px.
CORNERS = np.array([[x, y, 0.0] for x in (-0.03, 0.03) for y in (-0.04, 0.04)])
PLATE = EvaluationModel("plate", CORNERS, 0.1, SymmetryGroup.cyclic(2))
CAMERA = Pinhole(8, 1, 50.0, 50.0, 4.0, 0.5)


def at(x: float, y: float, z: float) -> np.ndarray:
    return transform(translation=np.array([x, y, z], float))


def row(*depths: float) -> np.ndarray:
    return np.array([depths], float)


def test_ar_of_one_plate_by_hand() -> None:
    # The estimate is 20 mm, one pixel, right of the truth: two of four pixels in the union are common to both.
    depth = DepthImages(
        row(1, 1, 1, 1, 2, 2, 2, 2), row(0, 0, 1, 1, 1, 0, 0, 0)[None], row(0, 1, 1, 1, 0, 0, 0, 0)[None]
    )
    errors = target_errors(PLATE, CAMERA, at(0.02, 0, 1)[None], np.ones(1), at(0, 0, 1)[None], np.ones(1), 1, depth)
    # The pixel of the estimate over the floor is visible: 1 m is not behind 2 m.
    assert errors.vsd is not None and errors.vsd[0, 0] == pytest.approx(np.full(10, 2 / 4))
    assert errors.mssd[0, 0] == pytest.approx(0.2)
    # One pixel of 8 is 80 pixels of 640.
    assert errors.mspd_px[0, 0] == pytest.approx(80)
    recalls = average_recalls([errors])
    # Correct below the threshold, not at it: VSD 0.5 at none of 0.05 ... 0.5, MSSD 0.2 at 0.25 ... 0.5, MSPD at none.
    assert (recalls.ar_vsd, recalls.ar_mssd, recalls.ar_mspd) == pytest.approx((0.0, 0.6, 0.0))
    assert recalls.ar == pytest.approx(0.2)


def test_a_depth_error_by_hand() -> None:
    # 12 mm too far: within 15 mm of the scene, 0.12 diameters, so wrong at tau 0.05 and 0.10 only.
    truth, far = row(0, 1, 1, 1, 0, 0, 0, 0), row(0, 1.012, 1.012, 1.012, 0, 0, 0, 0)
    depth = DepthImages(row(1, 1, 1, 1, 1, 1, 1, 1), far[None], truth[None])
    flat = Pinhole(8, 1, 1e9, 1e9, 4.0, 0.5)
    errors = target_errors(PLATE, flat, at(0, 0, 1.012)[None], np.ones(1), at(0, 0, 1)[None], np.ones(1), 1, depth)
    assert errors.vsd is not None and errors.vsd[0, 0] == pytest.approx([1, 1] + 8 * [0])
    assert errors.mssd[0, 0] == pytest.approx(0.12)
    recalls = average_recalls([errors])
    assert (recalls.ar_vsd, recalls.ar_mssd) == pytest.approx((0.8, 0.8))


def matched(errors: np.ndarray, threshold: float) -> int:
    """Return the matches of one threshold: estimates in order of score take the free truth with the least error."""
    free, found = set(range(errors.shape[1])), 0
    for row in errors:
        below = [(row[g], g) for g in free if row[g] < threshold]
        if below:
            free.remove(min(below)[1])
            found += 1
    return found


def test_recalls_agree_with_a_loop_over_thresholds_and_estimates() -> None:
    rng = np.random.default_rng(0)
    thresholds = np.arange(1, 11) * 0.05
    shapes = [(3, 4), (5, 5), (0, 2), (2, 2)]
    errors = [rng.uniform(0, 0.6, shape) for shape in shapes]
    recalls = average_recalls([TargetErrors("part", e, 100 * e, np.repeat(e[..., None], 10, -1)) for e in errors])
    expected = [sum(matched(e, threshold) for e in errors) / 13 for threshold in thresholds]
    assert recalls.recalls_mssd == pytest.approx(expected)
    assert recalls.recalls_mspd == pytest.approx(expected)
    assert recalls.recalls_vsd == pytest.approx(np.tile(expected, (10, 1)))
