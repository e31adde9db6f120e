"""Cutting into convex pieces: the work is bounded, and whatever is left uncut stays covered."""

from __future__ import annotations

import pytest
from manifold3d import Manifold

from simpick.assets import plane_cuts
from simpick.assets.csg import to_manifold, union
from tests.assets import defective_meshes as defects


def uncovered(solid: Manifold, hulls: list[Manifold]) -> float:
    """Return the share of the solid that no hull covers."""
    return (solid - union(*hulls)).volume() / solid.volume()


@pytest.mark.parametrize("most_work", [0, 20_000, 60_000])
def test_planes_are_tried_until_the_work_is_used_up(monkeypatch, most_work):
    spent = 0
    best_cut = plane_cuts._best_cut

    def counted(piece, planes, volume):
        nonlocal spent
        spent += len(planes) * (piece.solid.num_tri() + plane_cuts._WORK_PER_PLANE)
        return best_cut(piece, planes, volume)

    monkeypatch.setattr(plane_cuts, "_best_cut", counted)
    monkeypatch.setattr(plane_cuts, "_MOST_WORK", most_work)
    solid = to_manifold(defects.library_mesh("hex_nut"))
    hulls = plane_cuts.cut_into_hulls(solid)
    assert 0.9 * most_work <= spent <= most_work
    assert uncovered(solid, hulls) < 1e-3
    assert (len(hulls) == 1) == (most_work == 0)


def test_more_bodies_than_pieces_are_joined_by_place():
    ball = Manifold.sphere(1.0, 8)
    solid = union(*[ball.translate((3.0 * i, 3.0 * j, 0.0)) for i in range(15) for j in range(10)])
    assert len(solid.decompose()) > plane_cuts._MOST_HULLS
    hulls = plane_cuts.cut_into_hulls(solid)
    assert len(hulls) <= plane_cuts.MOST_PIECES
    assert uncovered(solid, hulls) < 1e-6
