"""Symmetries of CAD files: a ball, a part that is nearly a revolution, and the option that decides."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold

from simpick.assets import csg as s
from simpick.assets.cad_symmetry import cad_symmetries


@pytest.fixture(autouse=True)
def private_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path / "cache"))


def mesh_of(solid: Manifold):
    mesh = s.to_trimesh(solid).apply_scale(1e-3)
    return mesh.apply_translation(-mesh.bounds.mean(axis=0))


def test_a_ball_has_three_axes():
    group, text = cad_symmetries(mesh_of(Manifold.sphere(15, 48)))
    assert group.is_ball and text == "sphere"


def test_a_part_that_any_turn_moves_invisibly_is_a_revolution_and_said_to_be_nearly_one():
    group, text = cad_symmetries(mesh_of(s.extrude(s.regular(12, 20), 0, 40)))
    assert len(group.continuous) == 1 and abs(group.continuous[0].axis[2]) == pytest.approx(1.0)
    assert text.startswith("nearly a revolution, ends alike: any turn about (0, 0, 1) moves the surface by at most 0.3")


def test_a_high_order_that_shows_stays_discrete():
    group, text = cad_symmetries(mesh_of(s.extrude(s.regular(6, 20), 0, 40)))
    assert text == "12 rotations" and len(group.discrete) == 11


def test_a_small_mark_is_named_and_the_option_decides():
    mesh = mesh_of(s.cut(s.cylinder(20, 0, 10), s.cylinder(1.0, 5, 11).translate((19.6, 0, 0))))
    found, text = cad_symmetries(mesh)
    assert not found.continuous and "; nearly a revolution about (0, 0, 1)" in text
    assert len(cad_symmetries(mesh, "revolution")[0].continuous) == 1
    assert cad_symmetries(mesh, "none")[0].is_trivial


def test_the_second_call_reads_the_first_ones_result(monkeypatch):
    mesh = mesh_of(s.extrude(s.regular(12, 20), 0, 40))
    first, text = cad_symmetries(mesh)
    monkeypatch.setattr("simpick.assets.cad_symmetry.detect_symmetries", lambda mesh: pytest.fail("not cached"))
    again, same = cad_symmetries(mesh)
    assert same == text and np.array_equal(again.transforms(8), first.transforms(8))
