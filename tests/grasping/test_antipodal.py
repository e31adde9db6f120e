"""Jaw grasps of simple solids, whose right answers follow from their shape."""

import numpy as np
import pytest
import trimesh

from simpick.assets.grippers.sampling import antipodal
from simpick.assets.grippers.sampling.antipodal import AntipodalSampling
from simpick.assets.grippers.sampling.part_surface import PartSurface
from simpick.assets.part import Part
from simpick.geometry.transforms import transform
from simpick.records import Grasp

SETTINGS = AntipodalSampling()


def prism(outline_m: np.ndarray, length_m: float) -> Part:
    """Return the prism over a convex outline in x and z, along y, centred on its box."""
    ends = [np.insert(outline_m, 1, y, axis=1) for y in (-length_m / 2, length_m / 2)]
    mesh = trimesh.convex.convex_hull(np.concatenate(ends))
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return Part("prism", mesh, (mesh,))


def wedge(slope_deg: float) -> Part:
    """Return a block 30 mm wide, 30 mm long and 20 mm high; the side at +x is a ridge whose faces lean so far."""
    lean = 0.01 * np.tan(np.radians(slope_deg))
    ridge = [[0.03 - lean, 0.0], [0.03, 0.01], [0.03 - lean, 0.02]]
    return prism(np.array([[0.0, 0.0], *ridge, [0.0, 0.02]]), 0.03)


def placed(part: Part, along_y_m: float = 0.0, turned: bool = False) -> Grasp | None:
    """Return the grasp from above that closes along x, or along -x if `turned`."""
    sign = -1.0 if turned else 1.0
    R = np.diag([sign, -sign, -1.0])
    return antipodal._placed(PartSurface(part), transform(R, np.array([0.0, along_y_m, 0.0])), SETTINGS)


def test_each_pair_lies_in_the_cones_of_both_its_surfaces() -> None:
    # The side faces of an equilateral prism meet at 60 degrees: only its ends make pairs, along y.
    triangle = 0.03 * np.array([[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(3) / 2]])
    axes = antipodal._closing_axes(PartSurface(prism(triangle, 0.03)), SETTINGS, np.random.default_rng(0))
    assert len(axes) > 20
    assert all(abs(axis[1]) > np.cos(np.radians(SETTINGS.cone_deg)) for _, axis in axes)


@pytest.mark.parametrize("turned", [False, True])
def test_a_face_outside_the_cone_is_not_gripped_by_either_pad(turned: bool) -> None:
    assert placed(wedge(0.0), turned=turned) is not None
    assert placed(wedge(SETTINGS.cone_deg - 10.0), turned=turned) is not None
    assert placed(wedge(SETTINGS.cone_deg + 10.0), turned=turned) is None


def test_a_grasp_beside_the_centre_of_mass_is_worth_less() -> None:
    bar = prism(np.array([[-0.01, -0.01], [0.01, -0.01], [0.01, 0.01], [-0.01, 0.01]]), 0.16)
    middle, beside = placed(bar), placed(bar, along_y_m=0.06)
    assert middle is not None and beside is not None
    # Drawn surface points move the touching patch by about a millimetre.
    assert beside.quality / middle.quality == pytest.approx(np.exp(-0.06 / 0.03), rel=0.15)


def test_the_jaw_closes_on_the_width_that_the_part_has() -> None:
    grasp = placed(wedge(0.0))
    assert grasp is not None
    assert grasp.width_m == pytest.approx(0.03, abs=1e-4)
    assert grasp.T_part_tcp[0, 3] == pytest.approx(0.0, abs=1e-4)


def test_a_part_wider_than_the_stroke_is_not_gripped() -> None:
    assert placed(prism(np.array([[0.0, 0.0], [0.08, 0.0], [0.08, 0.02], [0.0, 0.02]]), 0.03)) is None


def test_a_part_that_would_run_into_the_palm_is_not_gripped() -> None:
    tower = trimesh.creation.box((0.016, 0.016, 0.4))
    assert placed(Part("tower", tower, (tower,))) is None
