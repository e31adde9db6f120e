"""Estimated costs of cuts agree with those of the cuts themselves."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold

from simpick.assets import csg, plane_cuts
from simpick.assets.cut_estimates import cut_costs
from tests.assets.defective_meshes import library_mesh


def exact_cost(solid: Manifold, plane: tuple[float, float, float, float], *, price: float) -> float:
    """Return the cost by cutting, which `cut_costs` estimates."""
    halves = solid.split_by_plane(plane[:3], plane[3])
    crumb = 1e-4 * solid.volume()
    if min(half.volume() for half in halves) < crumb:
        return np.inf
    bodies = [plane_cuts._Piece(body) for half in halves for body in half.decompose() if body.volume() > 0.1 * crumb]
    return sum(body.cost for body in bodies) + price * (len(bodies) - 2)


@pytest.mark.parametrize("name", ["l_bracket", "bushing", "hex_nut", "clevis_fork"])
def test_estimates_are_the_costs_of_the_cuts(name: str) -> None:
    solid = csg.to_manifold(library_mesh(name)).simplify(0.2)
    planes = plane_cuts._candidate_planes(solid)
    price = 0.002 * solid.volume() ** 1.5
    estimated = cut_costs(csg.to_trimesh(solid), np.array(planes), crumb=1e-4 * solid.volume(), price=price)
    exact = np.array([exact_cost(solid, plane, price=price) for plane in planes])
    agree = np.isclose(estimated, exact, rtol=1e-3)
    assert agree.mean() > 0.85
    assert estimated[exact.argmin()] <= np.sort(estimated)[plane_cuts._TRIED_PLANES - 1]


def test_shells_that_only_the_cut_joins_count_as_one_body() -> None:
    tubes = [
        csg.cut(csg.cylinder(10, 0, 30), csg.cylinder(r, -1, 31)).translate((x, 0, 0)) for r, x in ((9, 0), (5, 40))
    ]
    across = np.array([[0.0, 0.0, 1.0, 12.0]])
    (cost,) = cut_costs(csg.to_trimesh(csg.union(*tubes)), across, crumb=1.0, price=0.0)
    assert cost == pytest.approx(exact_cost(csg.union(*tubes), (0.0, 0.0, 1.0, 12.0), price=0.0), rel=1e-6)


def test_a_plane_along_a_face_joins_nothing_that_stands_on_it() -> None:
    comb = csg.union(csg.box((0, 0, -4), (50, 10, 0)), *[csg.box((x, 0, -1), (x + 5, 10, 20)) for x in (0, 20, 45)])
    (cost,) = cut_costs(csg.to_trimesh(comb), np.array([[0.0, 0.0, 1.0, 0.0]]), crumb=0.1, price=1.0)
    assert cost == pytest.approx(2.0, abs=1e-3)


def test_a_piece_without_candidate_planes_stays_whole() -> None:
    box = csg.box((0, 0, 0), (1, 2, 3))
    assert plane_cuts._best_cut(plane_cuts._Piece(box), [], box.volume()) == []
