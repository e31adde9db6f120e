"""Repair of defective meshes: the volume is right, what was done is said, what has no volume is refused with where."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from simpick.assets import CadSettings, import_cad
from simpick.assets.mesh_cleaning import cleaned
from simpick.assets.mesh_solids import is_sound, solidified
from simpick.assets.winding import misplaced_share, winding_numbers
from simpick.errors import MeshError, OpenMeshError
from tests.assets import defective_meshes as defects

_LIBRARY = ("hex_nut", "l_bracket", "hub_flange", "snap_clip", "crank_arm", "wing_nut")


def repaired(mesh: trimesh.Trimesh, **settings) -> tuple[trimesh.Trimesh, list[str]]:
    mesh, _, notes = cleaned(mesh, "a.stl")
    mesh, more = solidified(mesh.apply_scale(1e-3), "a.stl", **settings)
    return mesh, notes + more


@pytest.mark.parametrize("name", defects.BUILDERS)
def test_a_defective_mesh_gets_the_volume_that_was_meant(name):
    original = next((part for part in _LIBRARY if name.startswith(part)), None)
    volume = float(defects.library_mesh(original).volume) if original else defects.BRACKET_MM3
    mesh, _ = repaired(defects.BUILDERS[name]())
    assert is_sound(mesh)
    assert mesh.volume * 1e9 == pytest.approx(volume, rel=2e-3)


@pytest.mark.parametrize(
    ("name", "note"),
    [
        ("corners_off_by_1e_4", "welded seams up to 0.0006 file units wide"),
        ("five_faces_missing", "closed small holes (15 open edges, 1.29% of the surface added)"),
        ("all_faces_inward", "faces pointed inward and were flipped"),
        ("some_faces_inward", "made the faces' winding consistent"),
        ("a_loose_triangle", "dropped 1 loose faces that belong to no closed surface, near (39.8, -9.67, -20)"),
        ("far_from_the_origin", "lies 3.8e+04 times its size away from the origin"),
        ("touching_in_a_face", "2 closed surfaces overlap or touch and were united"),
        ("t_junctions", "split 7 faces where a neighbour's vertex lies on their edge (T-junctions)"),
    ],
)
def test_the_repair_is_said(name, note):
    _, notes = repaired(defects.BUILDERS[name]())
    assert any(note in text for text in notes), notes


def test_a_sound_mesh_is_left_as_it_is():
    mesh, notes = repaired(defects.bracket())
    assert notes == [] and len(mesh.faces) == len(defects.bracket().faces)


def test_a_surface_that_crosses_itself_is_wrapped_and_counts_its_volume_once():
    crossing, volume = defects.crossing_itself()
    mesh, notes = repaired(crossing)
    assert mesh.volume * 1e9 == pytest.approx(volume, rel=0.03)
    assert any("its surface crosses itself; replaced by a wrap" in note for note in notes)
    assert misplaced_share(mesh) == 0.0


def test_winding_numbers_count_how_often_a_point_is_surrounded():
    twice = defects.joined(trimesh.creation.icosphere(radius=2.0), trimesh.creation.icosphere(radius=1.0))
    points = np.array([[0.0, 0.1, 0.0], [1.5, 0.0, 0.0], [3.0, 0.0, 0.0]])
    assert winding_numbers(twice, points) == pytest.approx([2.0, 1.0, 0.0], abs=1e-6)


def test_a_mesh_full_of_gaps_is_wrapped():
    mesh = defects.bracket().subdivide().subdivide().subdivide().subdivide()
    gaps = np.random.default_rng(0).choice(len(mesh.faces), len(mesh.faces) // 8, replace=False)
    mesh, notes = repaired(defects.without(mesh, gaps))
    assert mesh.volume * 1e9 == pytest.approx(defects.BRACKET_MM3, rel=0.06)
    assert any("replaced by a wrap" in note for note in notes)


def test_a_cavity_stays_and_nested_solids_do_not_become_one():
    outer, inner = trimesh.creation.icosphere(radius=20.0), trimesh.creation.icosphere(radius=15.0)
    hollow, notes = repaired(defects.joined(outer, defects.flipped(inner)))
    assert hollow.volume * 1e9 == pytest.approx(outer.volume - inner.volume, rel=1e-6)
    assert any("1 closed cavities inside" in note for note in notes)
    solid, _ = repaired(defects.joined(outer, inner))
    assert solid.volume * 1e9 == pytest.approx(outer.volume, rel=1e-6)


def two_apart() -> trimesh.Trimesh:
    small = trimesh.creation.box([20, 20, 10]).apply_translation([60, 0, 0])
    return defects.joined(small, trimesh.creation.box([40, 20, 10]))


def test_bodies_apart_are_said_and_chosen_by_option():
    both, notes = repaired(two_apart())
    assert both.volume == pytest.approx(12e-6)
    assert any(
        "holds 2 bodies that do not touch (67 %, 33 % of the volume): taken as one rigid part" in n for n in notes
    )
    assert repaired(two_apart(), body=1)[0].volume == pytest.approx(8e-6)
    assert repaired(two_apart(), body=2)[0].volume == pytest.approx(4e-6)
    with pytest.raises(MeshError, match="body must be between 1 and 2"):
        repaired(two_apart(), body=3)


def test_bodies_that_share_an_edge_are_accepted():
    one = trimesh.creation.box([20, 20, 10])
    other = one.copy().apply_translation([20, 20, 0])
    mesh, notes = repaired(defects.joined(one, other))
    assert mesh.volume == pytest.approx(8e-6)
    assert any("edges with more than two faces" in note for note in notes)


def sheet() -> trimesh.Trimesh:
    flat = trimesh.Trimesh([[0, 0, 0], [40, 0, 0], [40, 30, 0], [0, 30, 0]], [[0, 1, 2], [0, 2, 3]])
    return flat.subdivide()


def shell() -> trimesh.Trimesh:
    """Return half of a sphere's surface."""
    ball = trimesh.creation.icosphere(radius=20.0)
    return defects.without(ball, np.flatnonzero(ball.triangles_center[:, 2] < 0))


@pytest.mark.parametrize(
    ("mesh", "text"),
    [
        (sheet(), "is flat: its thinnest side is 0 mm where its longest is 40 mm"),
        (trimesh.Trimesh([[1, 0, 1], [3, 2, -3], [0, -1, 3]], [[0, 1, 2]]), "has no surface: the corners of each"),
        (shell(), "encloses no volume: "),
        (defects.without(defects.bracket().subdivide(), range(40)), "encloses no volume: "),
        (defects.joined(shell(), defects.flipped(shell())), "encloses no volume"),
    ],
)
def test_what_has_no_volume_is_refused_with_its_open_edges(mesh, text):
    with pytest.raises(OpenMeshError) as error:
        repaired(mesh)
    assert text in str(error.value)
    assert isinstance(error.value.mesh, trimesh.Trimesh)


@pytest.mark.parametrize(("surface", "area_mm2"), [(sheet(), 1200.0), (shell(), float(shell().area))])
def test_a_sheet_is_thickened_by_the_option(surface, area_mm2):
    mesh, notes = repaired(surface, thickness_m=0.001)
    assert mesh.volume * 1e9 == pytest.approx(area_mm2, rel=0.02)
    assert "a.stl: a sheet, thickened to 1 mm" in notes


@pytest.mark.parametrize("simplify", [False, True])
def test_concentric_spheres_become_a_part(tmp_path, monkeypatch, simplify):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path / "cache"))
    balls = defects.joined(trimesh.creation.icosphere(radius=20.0), trimesh.creation.icosphere(radius=10.0))
    balls.export(tmp_path / "balls.stl")
    part = import_cad(tmp_path / "balls.stl", CadSettings(simplify=simplify)).part
    assert part.mesh.volume == pytest.approx(trimesh.creation.icosphere(radius=0.02).volume, rel=0.01)


def test_a_thin_tube_keeps_its_bore_in_contact(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path / "cache"))
    trimesh.creation.annulus(r_min=14, r_max=15, height=60, sections=64).export(tmp_path / "tube.stl")
    imported = import_cad(tmp_path / "tube.stl")
    assert sum(piece.volume for piece in imported.part.collision) < 1.1 * imported.part.mesh.volume
    assert not any("collision pieces fill" in note for note in imported.notes)


def test_collision_pieces_that_fill_a_wall_are_said(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path / "cache"))
    trimesh.creation.annulus(r_min=14.6, r_max=15, height=60, sections=64).export(tmp_path / "foil.stl")
    assert any("collision pieces fill" in note for note in import_cad(tmp_path / "foil.stl").notes)
