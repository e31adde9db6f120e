"""Disturbed starts, and the plot."""

from __future__ import annotations

import numpy as np
import pytest

from simpick.geometry import rotation_angle, transform
from simpick.pose_eval.refiner_basin import BasinPoint, perturbed, plot_basin


def test_starts_are_off_by_the_angle_asked_for_and_by_no_more_depth():
    rng = np.random.default_rng(1)
    T = transform(translation=np.array([0.1, 0.0, 0.8]))
    starts = np.array([perturbed(T, 20.0, 0.1, rng) for _ in range(50)])
    assert np.degrees(rotation_angle(starts[:, :3, :3])) == pytest.approx(np.full(50, 20.0))
    assert np.abs(starts[:, 2, 3] / 0.8 - 1).max() <= 0.1
    assert starts[:, 2, 3].std() > 0.02


def test_the_plot_is_written(tmp_path):
    points = [BasinPoint(start, start / 10, seen) for start in (5.0, 20.0) for seen in (0.3, 0.6, 1.0)]
    plot_basin(points, tmp_path / "new" / "basin.png")
    assert (tmp_path / "new" / "basin.png").stat().st_size > 5000
