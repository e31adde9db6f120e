"""Heights over the bin's floor, and which share of each part is the highest there."""

import numpy as np
import pytest

from simpick.grasping.exposure import exposures
from simpick.grasping.height_grid import CELL_M, HeightGrid

ORIGIN = np.array([0.5, -0.2])


def plate(rows: int, columns: int, height_m: float = 0.0, place_m: np.ndarray = ORIGIN) -> np.ndarray:
    """Return a point in each of so many cells in x and y; the first ones are at the grid's edge, `place_m`."""
    grid = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1).reshape(-1, 2)
    return np.column_stack([place_m + CELL_M * (grid + 0.5 * (grid > 0)), np.full(len(grid), height_m)])


@pytest.mark.parametrize(("rows", "columns"), [(21, 5), (5, 21), (1, 1)])
def test_the_grid_is_as_large_as_its_points_and_each_has_its_cell(rows: int, columns: int) -> None:
    points = plate(rows, columns)
    grid = HeightGrid.around([points])
    np.testing.assert_allclose(grid.lower_m, points[0, :2])
    assert grid.shape == (rows, columns)
    points[:, 2] = np.arange(len(points))
    np.testing.assert_array_equal(grid.top(points), points[:, 2].reshape(rows, columns))
    both = np.concatenate([points, points + np.array([0, 0, 0.5])])
    np.testing.assert_array_equal(grid.top(both), grid.bottom(both) + 0.5)


def test_points_far_from_the_others_are_left_out() -> None:
    near, far = plate(4, 6), np.array([[2.5, -0.19, 0.0], [0.51, 3.0, 0.0], [-2.0, -0.19, 0.0]])
    grid = HeightGrid.around([near, far])
    middle = np.median(np.concatenate([near, far])[:, :2], axis=0)
    np.testing.assert_allclose(grid.lower_m, [middle[0] - 1.0, near[:, 1].min()])
    assert grid.shape[0] in (500, 501) and 251 <= grid.shape[1] <= 256
    assert np.isfinite(grid.top(far)).sum() == 0 and np.isfinite(grid.top(near)).sum() == 24


def test_what_is_hardly_lower_is_exposed_as_well() -> None:
    below = plate(10, 10)
    for gap_m, share in ((0.002, 1.0), (0.004, 0.5)):
        assert exposures([below, plate(5, 10, gap_m)]).tolist() == [share, 1.0]


def test_a_part_far_outside_is_not_exposed() -> None:
    far = plate(4, 4, place_m=np.array([60.0, 0.0]))
    assert exposures([plate(10, 10), far]).tolist() == [1.0, 0.0]
    assert exposures([]).shape == (0,)
