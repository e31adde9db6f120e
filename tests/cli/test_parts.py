"""``simpick parts``: list, show, add."""

import cv2
import pytest
import trimesh

from simpick.assets import library_part_names
from simpick.cli.parts import PartsAdd, PartsList, PartsShow
from simpick.errors import ConfigError, OutputError


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
    assert "read in mm, because that makes it 60 mm long" in printed
    assert "added 'brick': 60 x 20 x 10 mm, 32.4 g, 1 collision pieces" in printed
    PartsList().run()
    row = next(line for line in capsys.readouterr().out.splitlines() if "brick" in line)
    assert "added" in row and "4 rotations" in row


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
