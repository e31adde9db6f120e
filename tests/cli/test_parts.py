"""``simpick parts``: list, show, add, remove."""

import cv2
import pytest
import trimesh

from simpick.assets import get_part, library_part_names, part_names
from simpick.assets.user_parts import user_parts_dir
from simpick.cli.main import main
from simpick.cli.parts import PartsAdd, PartsList, PartsShow
from simpick.errors import ConfigError, OutputError, UnknownPartError


@pytest.fixture(autouse=True)
def private_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "120")


def test_list_names_every_part(capsys):
    assert PartsList().run() == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in library_part_names())


def test_added_part_is_listed_and_what_was_decided_is_printed(tmp_path, capsys):
    trimesh.creation.box([60, 20, 10]).export(tmp_path / "brick.stl")
    assert PartsAdd(tmp_path / "brick.stl", density=2700.0).run() == 0
    printed = capsys.readouterr().out
    assert "read in mm, because that makes its size plausible (60 mm long" in printed
    assert "added 'brick': 60 x 20 x 10 mm, 32.4 g, 1 collision pieces" in printed
    PartsList().run()
    row = next(line for line in capsys.readouterr().out.splitlines() if "brick" in line)
    assert "added" in row and "4 rotations" in row


def test_a_removed_part_is_gone_and_can_be_added_again(tmp_path, capsys):
    file = tmp_path / "brick.stl"
    trimesh.creation.box([60, 20, 10]).export(file)
    for _ in range(2):
        PartsAdd(file).run()
        assert get_part("brick").name == "brick"
        capsys.readouterr()
        assert main(["parts", "remove", "brick"]) == 0
        assert capsys.readouterr().out.startswith("removed 'brick' with its copy of the CAD file in ")
        assert "brick" not in part_names() and list(user_parts_dir().iterdir()) == []
        with pytest.raises(UnknownPartError):
            get_part("brick")
    assert file.is_file(), "the user's own file stays"


def test_a_damaged_entry_can_be_removed(tmp_path):
    trimesh.creation.box([60, 20, 10]).export(tmp_path / "brick.stl")
    PartsAdd(tmp_path / "brick.stl").run()
    (user_parts_dir() / "brick" / "part.json").write_text("{")
    assert main(["parts", "remove", "brick"]) == 0
    assert "brick" not in part_names()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("hex_nut", "'hex_nut' comes with simpick and cannot be removed, only parts that you added can: brick"),
        ("random_7", "'random_7' comes with simpick and cannot be removed"),
        ("brik", "no added part named 'brik'. Valid: brick. To see all parts: simpick parts list. Did you mean"),
        ("../parts/brick", "no added part named '../parts/brick'. Valid: brick."),
    ],
)
def test_only_added_parts_can_be_removed(name, text, tmp_path, capsys):
    trimesh.creation.box([60, 20, 10]).export(tmp_path / "brick.stl")
    PartsAdd(tmp_path / "brick.stl").run()
    assert main(["parts", "remove", name]) == 2
    assert text in " ".join(capsys.readouterr().err.split())
    assert get_part("brick").name == "brick"


def test_nothing_to_remove_is_said(capsys):
    assert main(["parts", "remove", "brick"]) == 2
    assert "no added part named 'brick'. Valid: none so far." in " ".join(capsys.readouterr().err.split())


@pytest.mark.render
def test_show_draws_each_part_in_its_cell(tmp_path):
    out = tmp_path / "sheet.png"
    assert PartsShow(("hex_nut", "l_bracket"), out=out, cell_px=96).run() == 0
    image = cv2.imread(str(out))
    assert image is not None and image.shape[1] == 2 * 96
    background = image[0, 0]
    for cell in (image[:96, :96], image[:96, 96:]):
        assert (cell != background).any(axis=-1).mean() > 0.15
    with pytest.raises(OutputError, match=r"exists already\. Choose another file with --out, or pass --overwrite"):
        PartsShow(("hex_nut",), out=out).run()


def test_show_refuses_other_image_types(tmp_path):
    with pytest.raises(ConfigError, match=r"must be a \.png file"):
        PartsShow(("hex_nut",), out=tmp_path / "sheet.jpg").run()


def test_check_prints_one_page(tmp_path, capsys):
    trimesh.creation.box([6, 2, 2]).export(tmp_path / "my bar.stl")
    assert main(["parts", "check", f"{tmp_path / 'my bar.stl'}@cm", "--grippers", "suction"]) == 0
    printed = capsys.readouterr().out
    assert "my_bar: 60 x 20 x 20 mm, 28.8 g at 1200 kg/m^3, 12 faces, 1 collision pieces" in printed
    assert "- read in cm, as asked for (60 mm long)" in printed
    assert "- symmetry: 8 rotations" in printed and "- rests in 2 ways, its symmetries apart" in printed
    assert "suction (recommended)" in printed and "what will be hard: nothing known" in printed
    assert f"try: simpick run --parts '{tmp_path / 'my bar.stl'}@cm' --gripper suction" in printed


def test_check_draws_where_a_file_without_volume_is_open(tmp_path, capsys):
    box = trimesh.creation.box([60, 20, 20]).subdivide()
    box.update_faces(box.triangles_center[:, 2] < 9)
    box.export(tmp_path / "open.stl")
    out = tmp_path / "where.png"
    assert main(["parts", "check", str(tmp_path / "open.stl"), "--out", str(out)]) == 2
    captured = capsys.readouterr()
    assert f"picture of its open edges, in red: {out}" in captured.out
    assert "encloses no volume" in captured.err
    image = cv2.imread(str(out))
    assert image is not None
    red = (image[..., 2] > 200) & (image[..., 1] < 60)
    assert red.sum() > 100
