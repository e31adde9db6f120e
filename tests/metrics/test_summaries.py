"""Medians and recalls by hand, and the visibility bands' edges."""

import math

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.metrics import summarize, summarize_by_visibility
from simpick.records import PoseError


def error(rotation_deg: float, depth_mm: float = 0.0) -> PoseError:
    return PoseError(float(rotation_deg), 3.0, 1.0, float(depth_mm), 2.0)


def test_medians_are_over_answers_and_recalls_over_all() -> None:
    summary = summarize([error(1, -4), error(5, 2), error(20, 3), None])
    assert (summary.count, summary.answered) == (4, 3)
    assert summary.median_rotation_deg == 5
    assert summary.median_depth_mm == 3
    # 5 degrees are not less than 5 degrees.
    assert (summary.recall_5_deg, summary.recall_15_deg, summary.recall_30_deg) == (0.25, 0.5, 0.75)


def test_without_answers_medians_are_unknown_and_recalls_zero() -> None:
    summary = summarize([None])
    assert math.isnan(summary.median_rotation_deg)
    assert summary.recall_30_deg == 0
    assert math.isnan(summarize([]).recall_30_deg)


def test_bands_hold_their_lower_edge_and_the_last_both() -> None:
    fractions = np.array([0.05, 0.1, 0.3, 0.95, 1.0])
    bands = summarize_by_visibility([error(1), error(2), error(3), error(4), None], fractions)
    assert list(bands) == ["10-30 %", "30-50 %", "50-70 %", "70-90 %", "90-100 %"]
    assert [b.count for b in bands.values()] == [1, 1, 0, 0, 2]
    assert bands["30-50 %"].median_rotation_deg == 3
    assert bands["90-100 %"].answered == 1


def test_every_error_needs_its_visible_fraction() -> None:
    with pytest.raises(ConfigError, match="one visible fraction per error, got 1"):
        summarize_by_visibility([None, None], np.zeros(1))


def test_depth_is_reported_in_percent_where_true_depths_are_known() -> None:
    # 4 mm of 0.8 m, and 9 mm of 0.9 m.
    summary = summarize([error(1, -4), None, error(1, 9)], [0.8, 0.5, 0.9])
    assert summary.median_depth_percent == pytest.approx((0.5 + 1.0) / 2)
    assert math.isnan(summarize([error(1, 4)]).median_depth_percent)
    bands = summarize_by_visibility([error(1, 4), error(1, 9)], np.array([0.2, 0.95]), depths_m=[0.8, 0.9])
    assert bands["10-30 %"].median_depth_percent == pytest.approx(0.5)
    assert bands["90-100 %"].median_depth_percent == pytest.approx(1.0)


def test_every_error_needs_its_depth() -> None:
    with pytest.raises(ConfigError, match="one depth per error, got 1 for 2"):
        summarize([None, None], [0.5])
