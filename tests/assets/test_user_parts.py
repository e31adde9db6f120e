"""User CAD: a path works like a name, the unit is chosen and explained, bad files say what is wrong and what to do."""

import errno
import json
import logging
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from simpick.assets import (
    CadSettings,
    add_user_part,
    cad_import,
    get_part,
    import_cad,
    load_cad,
    part_names,
    user_parts,
)
from simpick.assets import convex_pieces as pieces_module
from simpick.assets.plane_cuts import MOST_PIECES
from simpick.assets.units import choose_unit
from simpick.errors import ConfigError, MeshError, OutputError, UnknownPartError
from tests.assets.step_files import step_box


@pytest.fixture(autouse=True)
def private_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path / "cache"))


def angle_mm() -> trimesh.Trimesh:
    """Return an L of two boxes, 60 x 20 x 40 mm, in mm, away from the origin."""
    foot = trimesh.creation.box([60, 20, 10]).apply_translation([30, 10, 5])
    leg = trimesh.creation.box([10, 20, 40]).apply_translation([5, 10, 20])
    return trimesh.boolean.union([foot, leg]).apply_translation([100, 200, 300])


def box_file(folder, extents, name="box.stl"):
    path = folder / name
    trimesh.creation.box(extents).export(path)
    return path


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".glb", ".off", ".3mf", ".dae"])
def test_every_format_gives_the_same_part(tmp_path, suffix):
    path = tmp_path / f"My Angle-2{suffix}"
    angle_mm().export(path)
    part = get_part(str(path))
    assert part.name == "my_angle_2"
    assert part.extents_m == pytest.approx([0.06, 0.02, 0.04], rel=1e-5)
    assert part.mesh.volume == pytest.approx(60 * 20 * 10e-9 + 10 * 20 * 30e-9, rel=1e-5)
    assert part.mesh.is_watertight and part.symmetries.is_trivial
    assert 2 <= len(part.collision) <= MOST_PIECES
    assert sum(piece.volume for piece in part.collision) == pytest.approx(part.mesh.volume, rel=0.1)


@pytest.mark.parametrize(("unit", "scale"), [("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))", 1.0),
                                             ("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.))", 1000.0)])  # fmt: skip
def test_a_step_file_is_read_in_millimetres_whatever_its_own_unit(tmp_path, unit, scale):
    path = tmp_path / "box.step"
    path.write_text(step_box((60 / scale, 20 / scale, 10 / scale), unit))
    imported = import_cad(path)
    assert imported.part.extents_m == pytest.approx([0.06, 0.02, 0.01], rel=1e-6)
    assert imported.part.mesh.volume == pytest.approx(12e-6, rel=1e-5)
    assert (imported.unit, imported.part.metres_per_cad_unit) == ("mm", 1e-3)
    assert "box.step: read in mm, as the file states (60 mm long)" in imported.notes


def test_cad_frame_leads_back_to_the_files_coordinates(tmp_path):
    path = tmp_path / "angle.stl"
    angle_mm().export(path)
    imported = import_cad(path)
    T, part = imported.part.T_cad_part, imported.part
    in_file = (np.asarray(part.mesh.vertices) @ T[:3, :3].T + T[:3, 3]) / imported.metres_per_unit
    assert in_file.min(axis=0) == pytest.approx([100, 200, 300], abs=1e-3)


@pytest.mark.parametrize(
    ("longest", "unit"),
    [(60.0, "mm"), (5.0, "mm"), (300.0, "mm"), (0.06, "m"), (0.005, "m"), (0.3, "m"), (2.5, "inch"), (0.4, "inch"),
     (1000.0, "mm"), (0.001, "m")],
)  # fmt: skip
def test_unit_is_chosen_by_plausible_size(longest, unit):
    assert choose_unit(longest, file="a.stl").unit == unit


@pytest.mark.parametrize(
    ("file", "longest", "unit"),
    [("block_cm.stl", 6.0, "cm"), ("tiny_4mm.stl", 4.0, "mm"), ("Plate-inch.stl", 6.0, "inch"),
     ("block_cm.stl", 200.0, "mm"), ("comma.stl", 6.0, "mm")],
)  # fmt: skip
def test_a_unit_in_the_files_name_counts_if_the_size_is_possible(file, longest, unit):
    assert choose_unit(longest, file=file).unit == unit


def test_a_stated_unit_is_taken_unless_another_is_asked_for():
    assert choose_unit(6.0, file="a.3mf", stated="inch").unit == "inch"
    assert choose_unit(6.0, "cm", file="a.3mf", stated="inch").unit == "cm"


def test_unit_choice_is_explained_and_logged(tmp_path, caplog):
    path = box_file(tmp_path, [6, 2, 1])
    with caplog.at_level(logging.INFO, logger="simpick.assets.cad_import"):
        load_cad(path)
    expected = (
        "box.stl: read in mm, because that makes its size plausible (6 mm long; 152.4 mm in inch; 60 mm in cm). "
        "For another unit: box.stl@UNIT, or --unit"
    )
    assert expected in caplog.messages


def test_unit_can_be_overridden(tmp_path):
    path = box_file(tmp_path, [6, 2, 1])
    assert load_cad(path, unit="cm").extents_m == pytest.approx([0.06, 0.02, 0.01])
    assert get_part(f"{path}@inch").extents_m[0] == pytest.approx(0.1524)


@pytest.mark.parametrize(
    ("longest", "unit", "text"),
    [
        (2000.0, "auto", "must be between 1 mm and 1000 mm, the limits of the contact simulation, and is not in mm"),
        (2000.0, "auto", "No unit fits (mm, cm, m, inch): scale the model"),
        (60.0, "m", "and is not in m, as asked for: it would be 60 mm in mm, 600 mm in cm, 60000 mm in m, 1524 mm in "
                    "inch. If it is in mm or cm, give that unit: the file@mm, or --unit mm"),
    ],
)  # fmt: skip
def test_unlikely_size_is_an_error(longest, unit, text):
    with pytest.raises(MeshError) as error:
        choose_unit(longest, unit)
    assert text in str(error.value)


def cad_error(path, **settings) -> str:
    with pytest.raises(MeshError) as error:
        get_part(str(path)) if not settings else load_cad(path, **settings)
    return str(error.value)


def test_missing_file(tmp_path):
    assert cad_error(tmp_path / "no.stl") == f"no mesh file at {tmp_path / 'no.stl'}. Check the path."


def test_wrong_file_type(tmp_path):
    path = tmp_path / "part.igs"
    path.write_text("S")
    assert cad_error(path) == (
        "part.igs: file type must be one of .stl, .obj, .ply, .glb, .off, .step, .stp, .3mf, .dae, got '.igs'"
    )


def test_a_format_whose_package_is_missing_names_it(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    (tmp_path / "a.step").write_text("ISO-10303-21;")
    assert "a.step: reading .step needs the package cascadio. Install it with: pip install 'simpick[cad]'" in cad_error(
        tmp_path / "a.step"
    )


def test_empty_file(tmp_path):
    (tmp_path / "a.stl").touch()
    assert cad_error(tmp_path / "a.stl") == "a.stl: the file is empty (0 bytes). Export it again from CAD."


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".glb", ".obj"])
def test_unreadable_file(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(bytes(np.random.default_rng(0).integers(0, 256, 500, dtype=np.uint8)))
    text = cad_error(path)
    assert text.startswith(f"a{suffix}: ") and "xport" in text


def test_mesh_without_faces(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    assert "Export" in cad_error(path) or "export" in cad_error(path)


def test_nan_vertices(tmp_path):
    mesh = trimesh.creation.box([60, 20, 10])
    mesh.vertices[3] = np.nan
    mesh.export(tmp_path / "a.ply")
    assert cad_error(tmp_path / "a.ply") == ("a.ply: 1 of 8 vertices are NaN or infinite. Export it again from CAD.")


def test_open_mesh_says_how_many_edges_and_what_to_do(tmp_path):
    mesh = trimesh.creation.cylinder(10, 40, sections=32)
    mesh.update_faces(np.asarray(mesh.face_normals)[:, 2] < 0.9)
    mesh.export(tmp_path / "cup.stl")
    text = cad_error(tmp_path / "cup.stl")
    assert "cup.stl: encloses no volume: 32 of 160 edges are open" in text
    assert "export it as a solid, close it in a mesh editor" in text


def test_a_missing_triangle_is_mended_and_said(tmp_path):
    mesh = trimesh.creation.box([60, 20, 10])
    mesh.update_faces(np.arange(12) != 4)
    mesh.export(tmp_path / "a.stl")
    imported = import_cad(tmp_path / "a.stl")
    assert imported.part.mesh.volume == pytest.approx(12e-6)
    assert any("closed small holes (3 open edges, " in note for note in imported.notes)


def test_inverted_faces_are_turned_and_said(tmp_path):
    mesh = trimesh.creation.box([60, 20, 10])
    mesh.invert()
    mesh.export(tmp_path / "a.stl")
    imported = import_cad(tmp_path / "a.stl")
    assert imported.part.mesh.volume == pytest.approx(12e-6)
    assert any("faces pointed inward" in note for note in imported.notes)


def test_overlapping_bodies_count_their_volume_once(tmp_path):
    two = trimesh.util.concatenate(
        [trimesh.creation.box([60, 20, 10]), trimesh.creation.box([20, 20, 30]).apply_translation([5, 0, 0])]
    )
    two.export(tmp_path / "a.stl")
    imported = import_cad(tmp_path / "a.stl")
    assert imported.part.mesh.volume == pytest.approx((12000 + 12000 - 4000) * 1e-9)
    assert any("2 closed surfaces overlap or touch" in note for note in imported.notes)


def test_flat_mesh(tmp_path):
    text = cad_error(box_file(tmp_path, [60, 20, 0.01]))
    assert "box.stl: is flat: its thinnest side is 0.01 mm where its longest is 60 mm" in text
    assert "give the surface a thickness in CAD" in text


def test_huge_mesh_says_how_to_simplify(tmp_path, monkeypatch):
    monkeypatch.setattr(cad_import, "MAX_FACES", 1000)
    path = tmp_path / "ball.stl"
    trimesh.creation.box([20, 20, 20]).subdivide().subdivide().subdivide().subdivide().export(path)
    text = cad_error(path)
    assert "ball.stl: must have at most 1000 faces, got 3072" in text and "--simplify" in text
    assert len(load_cad(path, simplify=True).mesh.faces) < 100


def test_unknown_name_lists_what_exists():
    with pytest.raises(UnknownPartError) as error:
        get_part("bolt_m9")
    assert str(error.value).startswith("no part named 'bolt_m9'. Valid: bushing, cable_clip,")
    assert "A path to a CAD file (STL, OBJ, PLY, GLB, OFF, STEP, 3MF, DAE) is a part, too." in str(error.value)


@pytest.mark.parametrize("setting", [{"density_kg_m3": 0.0}, {"rgb": (2.0, 0.0, 0.0)}, {"unit": "yard"}])
def test_bad_settings(tmp_path, setting):
    with pytest.raises(ConfigError, match="must be"):
        choose_unit(60.0, **setting) if "unit" in setting else CadSettings(**setting)


def test_added_part_is_found_by_its_name_with_its_settings(tmp_path):
    add_user_part(box_file(tmp_path, [60, 20, 10]), CadSettings(density_kg_m3=2000, rgb=(1, 0, 0)), name="brick")
    part = get_part("brick")
    assert part.mass_kg == pytest.approx(0.024)
    assert part.material.rgb == (1, 0, 0)
    assert len(part.symmetries.discrete) == 3
    assert "brick" in part_names()


def test_name_clashes_are_errors(tmp_path):
    path = box_file(tmp_path, [60, 20, 10])
    add_user_part(path, name="brick")
    with pytest.raises(ConfigError, match=r"added before\. Choose another name .*, or replace it \(--overwrite\)"):
        add_user_part(path, name="brick")
    with pytest.raises(ConfigError, match="a library part is already named 'hex_nut'"):
        add_user_part(path, name="hex_nut")
    with pytest.raises(ConfigError, match="must start with a letter"):
        add_user_part(path, name="../evil")


def test_names_that_file_systems_confuse_or_refuse(tmp_path):
    path = box_file(tmp_path, [60, 20, 10])
    add_user_part(path, name="brick")
    with pytest.raises(
        ConfigError, match=r"must differ from others in more than the case .*got 'Brick' beside 'brick'"
    ):
        add_user_part(path, name="Brick")
    with pytest.raises(ConfigError, match=r"must have at most 100 characters, got 300: x{60}\.\.\."):
        add_user_part(path, name="x" * 300)


def test_a_part_that_cannot_be_replaced_stays(tmp_path, monkeypatch):
    path = box_file(tmp_path, [60, 20, 10])
    add_user_part(path, name="brick")
    before, replace = get_part("brick").content_hash, Path.replace

    def fail_for_the_new(self, target):
        if self.is_dir() and self.name.startswith(".") and not self.name.endswith("-earlier"):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return replace(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail_for_the_new)
        with pytest.raises(OutputError, match=r"cannot register 'brick' .*Read-only file system"):
            add_user_part(box_file(tmp_path, [50, 20, 10]), name="brick", replace=True)
    assert get_part("brick").content_hash == before
    add_user_part(box_file(tmp_path, [50, 20, 10]), name="brick", replace=True)
    assert get_part("brick").content_hash != before
    assert [f.name for f in user_parts.user_parts_dir().iterdir()] == ["brick"]


def test_a_part_that_is_still_being_added_is_not_listed(tmp_path):
    add_user_part(box_file(tmp_path, [60, 20, 10]), name="brick")
    folder = user_parts.user_parts_dir()
    shutil.copytree(folder / "brick", folder / ".block-x1y2z3")
    assert user_parts.user_part_names() == ["brick"]


def test_replacing_a_part_takes_effect_at_once(tmp_path):
    add_user_part(box_file(tmp_path, [60, 20, 10]), name="brick")
    assert get_part("brick").extents_m[0] == pytest.approx(0.06)
    add_user_part(box_file(tmp_path, [50, 20, 10]), name="brick", replace=True)
    assert get_part("brick").extents_m[0] == pytest.approx(0.05)


def test_a_path_named_like_a_library_part_does_not_hide_it(tmp_path):
    assert get_part(str(box_file(tmp_path, [60, 20, 10], "hex_nut.stl"))).name == "hex_nut_cad"


def test_a_file_that_is_neither_binary_nor_text_is_called_damaged(tmp_path, monkeypatch):
    def guess_the_encoding(*_, **__):
        raise ModuleNotFoundError("No module named 'charset_normalizer'")

    monkeypatch.setattr(trimesh, "load_scene", guess_the_encoding)
    (tmp_path / "cut.stl").write_bytes(b"\x80\xff" * 50)
    text = cad_error(tmp_path / "cut.stl")
    assert "cut.stl: cannot be read as .stl: it is neither a whole binary file nor plain text, so truncated" in text
    assert "charset" not in text


def test_damaged_entry_says_how_to_mend_it(tmp_path):
    add_user_part(box_file(tmp_path, [60, 20, 10]), name="brick")
    (user_parts.user_parts_dir() / "brick" / "part.json").write_text(json.dumps({"unit": "mm"}))
    with pytest.raises(MeshError, match="Add it again: simpick parts add FILE --name brick --overwrite"):
        get_part("brick")


def test_unwritable_cache_is_an_error(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.touch()
    monkeypatch.setenv("SIMPICK_CACHE", str(blocked))
    with pytest.raises(OutputError, match="SIMPICK_CACHE"):
        add_user_part(box_file(tmp_path, [60, 20, 10]), name="brick")


def test_decomposition_is_made_once_and_deterministic(tmp_path, monkeypatch):
    mesh = angle_mm().apply_scale(1e-3)
    first = pieces_module.convex_pieces(mesh)
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path / "other"))
    again = pieces_module.convex_pieces(mesh)
    assert all(np.array_equal(a.vertices, b.vertices) for a, b in zip(first, again, strict=True))
    monkeypatch.setattr(pieces_module, "_decompose", lambda mesh: pytest.fail("not cached"))
    pieces_module.convex_pieces(mesh)
