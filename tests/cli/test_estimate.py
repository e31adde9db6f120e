"""``simpick estimate``: options, files written, and images that cannot be answered."""

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from trimesh.visual.color import ColorVisuals

from simpick.assets import get_part
from simpick.assets.units import Unit
from simpick.cli.main import main
from simpick.geometry import Pinhole, so3_exp, transform
from simpick.photos.outputs import describe_part
from simpick.photos.parts import load_parts
from simpick.rendering import PartRenderer

CAMERA = Pinhole(160, 120, 240.0, 240.0, 80.5, 60.5)
NUMBERS = ["240", "240", "80", "60"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a CAD file in inches, an image of it, an image of another size and a damaged one."""
    folder = tmp_path_factory.mktemp("photos")
    trimesh.creation.box((2.0, 1.0, 0.5)).export(folder / "block.stl")
    main(["parts", "add", str(folder / "block.stl"), "--name", "inch_block", "--unit", "inch", "--overwrite"])
    T = transform(so3_exp(np.array([0.5, 0.7, 0.2])), np.array([0.0, 0.01, 0.25]))
    part = get_part("inch_block")
    with PartRenderer(part, 120, 160) as renderer:
        views = renderer.render(T[None], CAMERA)
    assert views.rgb is not None
    rgb = np.where(views.masks[0][..., None], views.rgb[0], np.uint8(60))
    (folder / "images").mkdir()
    cv2.imwrite(str(folder / "images" / "a1.png"), rgb[..., ::-1])
    cv2.imwrite(str(folder / "images" / "a2.png"), np.zeros((700, 900, 3), np.uint8))
    (folder / "images" / "a3.png").write_bytes(b"\x89PNG damaged")
    cv2.imwrite(str(folder / "mask.png"), 255 * views.masks[0].astype(np.uint8))
    (folder / "found.json").write_text(json.dumps({"a1.png": [{"mask": "mask.png"}], "a2.png": []}))
    return folder


def run(folder: Path, *arguments: str) -> int:
    camera = ["--camera", *NUMBERS, "--part", "inch_block", "--mode", "retrieval"]
    return main(["estimate", str(folder / "images"), *camera, *arguments])


def test_a_folder_gives_poses_in_the_cad_unit_and_names_what_failed(folder: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert run(folder, "--detections", str(folder / "found.json"), "--out", str(out), "--count", "1") == 1
    content = json.loads((out / "poses.json").read_text())
    good, other_size, damaged = content["images"]
    assert content["parts"]["inch_block"]["unit"] == "inch"
    (estimate,) = good["estimates"]
    assert estimate["t"][2] == pytest.approx(0.25 / 0.0254, rel=0.05), "in inches"
    assert estimate["probability"] is None and estimate["mask_agreement"] > 0.7
    assert "does not suit an image of 900 x 700 px" in other_size["error"]
    assert "truncated" in damaged["error"]
    (row,) = csv.DictReader((out / "poses.csv").read_text().splitlines())
    assert row["unit"] == "inch" and np.array(row["R"].split(), float).reshape(3, 3) == pytest.approx(
        np.array(estimate["R"])
    )
    overlay = cv2.imread(str(out / "overlays" / "a1.png"))
    assert overlay is not None and overlay.shape == (120, 160, 3)
    assert (out / "poses.rrd").stat().st_size > 1000
    text = capsys.readouterr().out
    assert "pixel centres at integers" in text and "2 without an answer" in text
    assert run(folder, "--out", str(out)) == 2
    assert "holds poses already. Choose another folder with --out, or pass --overwrite" in capsys.readouterr().err


def test_nothing_detected_says_what_to_do(folder: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "none.json").write_text("{}")
    arguments = ["--camera", *NUMBERS, "--part", "inch_block", "--mode", "retrieval"]
    detections = ["--detections", str(tmp_path / "none.json"), "--out", str(tmp_path / "out")]
    assert main(["estimate", str(folder / "images" / "a1.png"), *arguments, *detections]) == 0
    assert "none.json lists no detection of this image" in capsys.readouterr().out.replace("\n", " ")
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((120, 160, 3), 90, np.uint8))
    assert main(["estimate", str(tmp_path / "empty.png"), *arguments, "--out", str(tmp_path / "learned")]) == 0
    assert "note: nothing was detected" in capsys.readouterr().out


def test_detections_of_categories_that_are_no_part_are_counted(folder: Path, tmp_path: Path, capsys) -> None:
    entry = {"scene_id": 0, "image_id": 1, "bbox": [40, 30, 80, 70], "score": 0.9, "time": 0.1}
    (tmp_path / "cnos.json").write_text(json.dumps([entry | {"category_id": k} for k in (1, 5, 9, 9)]))
    arguments = ["--camera", *NUMBERS, "--part", "inch_block", "--mode", "retrieval"]
    detections = ["--detections", str(tmp_path / "cnos.json"), "--out", str(tmp_path / "out")]
    assert main(["estimate", str(folder / "images" / "a1.png"), *arguments, *detections]) == 0
    text = capsys.readouterr().out.replace("\n", " ")
    assert "note: 3 of 4 detections in" in text and "(1 inch_block), got 5, 9" in text
    assert "1 poses in 1 images" in text


def test_a_part_of_which_nothing_is_seen_says_so_and_rivals_are_shown(folder: Path, tmp_path: Path, capsys) -> None:
    arguments = ["--camera", *NUMBERS, "--part", "inch_block", "--mode", "retrieval"]
    boxes = ["--boxes", "900", "900", "950", "950", "40", "30", "120", "100"]
    image = str(folder / "images" / "a1.png")
    assert main(["estimate", image, *arguments, *boxes, "--show-rivals", "--out", str(tmp_path / "out")]) == 0
    text = capsys.readouterr().out
    assert "note: 1 detections have no estimate: outside the image, or too few pixels" in text
    assert "a1.png: 1 poses" in text and "rival 0." in text


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--camera", "1", "2", "--part", "hex_bolt"], "four numbers FX FY CX CY, got '1 2'; give the camera matrix"),
        (["--camera", "a", "2", "3", "4", "--part", "hex_bolt"], "must be four numbers FX FY CX CY, got 'a 2 3 4'"),
        (["--camera", *NUMBERS, "--part", "hex_bolt", "--detections", "boxes"], "must come with --boxes X1 Y1 X2 Y2"),
        (["--camera", *NUMBERS, "--part", "hex_bolt", "--boxes", "1", "2", "3"], "four numbers each, got 3 numbers"),
        (["--camera", *NUMBERS, "--part", "hex_bolt", "--boxes", "9", "2", "3", "4"], "x2 > x1 and y2 > y1"),
        (["--camera", *NUMBERS, "--part", "hex_bolt", "hex_nut", "--boxes", "1", "2", "3", "4"], "there are 2; give"),
        (["--camera", "no.yaml", "--part", "hex_bolt"], "no camera file no.yaml"),
        (["--camera", *NUMBERS, "--part", "hex_bold"], "no part named 'hex_bold'"),
        (["--camera", *NUMBERS, "--part", "hex_bolt", "--detections", "good"], "no detections named 'good'"),
    ],
)
def test_options_that_contradict_each_other_are_named(
    options: list[str], problem: str, folder: Path, tmp_path: Path, capsys
) -> None:
    assert main(["estimate", str(folder / "images" / "a1.png"), *options, "--out", str(tmp_path)]) == 2
    assert problem in capsys.readouterr().err


@pytest.mark.parametrize("longest", [5.0, 0.00005])
def test_a_part_of_the_wrong_unit_is_named(longest: float, folder: Path, tmp_path: Path, capsys) -> None:
    path = tmp_path / "odd.stl"
    trimesh.creation.box((longest, longest / 2, longest / 3)).export(path)
    camera = ["--camera", *NUMBERS, "--part", str(path), "--unit", "m"]
    assert main(["estimate", str(folder / "images" / "a1.png"), *camera, "--out", str(tmp_path)]) == 2
    assert "odd.stl" in capsys.readouterr().err


def test_an_image_of_another_size_than_the_first_is_named(folder: Path, tmp_path: Path, capsys) -> None:
    image = cv2.imread(str(folder / "images" / "a1.png"))
    assert image is not None
    for name, rows in (("a.png", 120), ("b.png", 110), ("c.png", 120)):
        cv2.imwrite(str(tmp_path / name), image[:rows])
    (tmp_path / "none.json").write_text("{}")
    arguments = ["--camera", *NUMBERS, "--part", "inch_block", "--mode", "retrieval"]
    detections = ["--detections", str(tmp_path / "none.json"), "--out", str(tmp_path / "out")]
    assert main(["estimate", str(tmp_path), *arguments, *detections]) == 0
    notes = [i["notes"] for i in json.loads((tmp_path / "out" / "poses.json").read_text())["images"]]
    assert ["where the first image has 160 x 120 px" in " ".join(n) for n in notes] == [False, True, False]


def test_a_guessed_unit_is_stated_with_the_sizes_in_others(tmp_path: Path) -> None:
    path = tmp_path / "block.stl"
    trimesh.creation.box((5.0, 4.0, 3.0)).export(path)

    def text(given: str, unit: Unit = "auto") -> str:
        (part,) = load_parts([given], unit)
        return describe_part(part, given, unit)

    assert text(str(path)) == (
        "block: 5.0 x 4.0 x 3.0 mm; poses in mm, the unit of its file (127 mm in inch; 50 mm in cm). "
        f"For another unit: {path}@UNIT, or --unit"
    )
    assert text(f"{path}@cm") == text(str(path), "cm") == text(f"{path}@mm", "cm")
    assert text(f"{path}@cm") == "block: 50.0 x 40.0 x 30.0 mm; poses in cm, the unit of its file"
    assert text("inch_block").endswith("poses in inch")


def test_files_with_a_unit_and_added_parts_keep_their_colours(tmp_path: Path) -> None:
    block = trimesh.creation.box((40.0, 30.0, 20.0))
    left = block.vertices[:, :1] < 0
    block.visual = ColorVisuals(block, vertex_colors=np.where(left, [[220, 20, 20, 255]], [[20, 20, 220, 255]]))
    block.export(tmp_path / "block.ply")
    main(["parts", "add", str(tmp_path / "block.ply"), "--name", "two_coloured", "--overwrite"])
    for part in load_parts([f"{tmp_path / 'block.ply'}@cm", "two_coloured"]):
        assert part.face_rgb is not None and part.face_rgb.std(axis=0).max() > 50, part.name
