"""The share of resting poses in which a part can be picked."""

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.geometry.transforms import transform
from simpick.grasping.coverage import resting_coverage

NUT = get_part("hex_nut")
FLAT, SUNK = transform(translation=np.array([0.0, 0.0, 0.008])), transform(translation=np.array([0.0, 0.0, -0.5]))


def resting(monkeypatch: pytest.MonkeyPatch, *poses: tuple[np.ndarray, float]) -> None:
    """Let parts rest in these poses, each with its share."""
    Ts, shares = np.stack([T for T, _ in poses]), np.array([share for _, share in poses])
    monkeypatch.setattr("simpick.grasping.coverage.stable_poses", lambda part: (Ts, shares))


def test_poses_count_by_their_share_and_rare_ones_not_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    resting(monkeypatch, (FLAT, 0.6), (SUNK, 0.2), (FLAT, 0.005))
    assert resting_coverage(NUT, "jaw") == pytest.approx(0.75)


def test_where_all_poses_are_rare_the_first_stand_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    resting(monkeypatch, *[(FLAT, 0.004)] * 18, *[(SUNK, 0.004)] * 6, *[(FLAT, 0.004)] * 100)
    assert resting_coverage(NUT, "jaw") == pytest.approx(0.75)


def test_as_many_grasps_are_looked_for_as_are_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    resting(monkeypatch, (FLAT, 1.0))
    assert resting_coverage(NUT, "jaw", least=8) == 1.0
    assert resting_coverage(NUT, "jaw", least=5000) == 0.0
