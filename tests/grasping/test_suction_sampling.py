"""Suction grasps of a bar, whose right answers follow from its shape."""

import numpy as np
import pytest
import trimesh

from simpick.assets.grippers.sampling import suction
from simpick.assets.grippers.sampling.part_surface import PartSurface
from simpick.assets.grippers.sampling.suction import SuctionSampling
from simpick.assets.part import Part
from simpick.records import Grasp

UP = np.array([0.0, 0.0, 1.0])


def bar(density_kg_m3: float = 1000.0) -> Part:
    mesh = trimesh.creation.box((0.16, 0.04, 0.02))
    return Part("bar", mesh, (mesh,), density_kg_m3=density_kg_m3)


def placed(part: Part, x_m: float, y_m: float = 0.0) -> Grasp | None:
    """Return the face laid on the bar's upper side."""
    return suction._placed(PartSurface(part), np.array([x_m, y_m, 0.01]), UP, SuctionSampling())


def test_the_face_lies_on_the_surface_and_points_into_it() -> None:
    grasp = placed(bar(), 0.02)
    assert grasp is not None
    np.testing.assert_allclose(grasp.T_part_tcp[:3, 3], [0.02, 0.0, 0.01], atol=1e-5)
    np.testing.assert_allclose(grasp.T_part_tcp[:3, 2], -UP, atol=1e-9)


def test_a_grasp_beside_the_centre_of_mass_is_worth_less() -> None:
    middle, beside = placed(bar(), 0.0), placed(bar(), 0.03)
    assert middle is not None and beside is not None
    assert beside.quality / middle.quality == pytest.approx(np.exp(-0.03 / 0.03), rel=0.02)


def test_weight_beside_the_centre_of_mass_peels_the_face_off() -> None:
    heavy = bar(density_kg_m3=3000.0)
    assert placed(heavy, 0.0) is not None
    assert placed(heavy, 0.06) is None


def test_a_part_that_is_too_heavy_is_not_held() -> None:
    assert placed(bar(density_kg_m3=50_000.0), 0.0) is None


def test_a_face_that_hangs_over_the_edge_covers_fewer_cells() -> None:
    whole, half = placed(bar(), 0.0), placed(bar(), 0.0, y_m=0.02)
    assert whole is not None and (half is None or half.quality < 0.8 * whole.quality)
