"""Numbers in data sets have the right type and range before anything is computed with them."""

import contextlib
import gzip
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simpick.bop import BopDataset, read_detections, read_results, write_results
from simpick.bop.json_files import read_json, read_json_by_id
from simpick.bop.results_csv import HEADER, BopResult
from simpick.errors import DatasetError
from simpick.geometry.transforms import transform
from simpick.pose_eval.bop_evaluation import known_results

HUGE = 10**400


def _edit(path: Path, change) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize("key", ["--1", "²", "-1", "1.0", "", " 1", "1_0", "٣", "2147483648", "9" * 5000])
def test_keys_that_are_no_ids_are_named(tmp_path: Path, key: str) -> None:
    (tmp_path / "ids.json").write_text(json.dumps({"1": {}, key: {}}))
    with pytest.raises(
        DatasetError, match=r"ids\.json, key '.{0,60}': keys must be whole numbers from 0 to 2147483647"
    ):
        read_json_by_id(tmp_path / "ids.json", "")


def test_one_id_under_two_keys_is_refused(tmp_path: Path) -> None:
    (tmp_path / "ids.json").write_text('{"1": {}, "01": {}}')
    with pytest.raises(DatasetError, match=r"ids\.json, key '01': a second entry of 1; remove one of them"):
        read_json_by_id(tmp_path / "ids.json", "")


@pytest.mark.parametrize("text", ["[" * 10**5, "[" * 80 + "]" * 80, '{"a":' * 70 + "1" + "}" * 70, "1" * 5000, "\xff"])
def test_text_that_is_no_file_of_numbers_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "deep.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(DatasetError, match=r"deep\.json"):
        read_json(tmp_path / "deep.json", "")


def test_every_damaged_byte_of_a_gzip_file_is_an_error_or_harmless(tmp_path: Path) -> None:
    file, content = tmp_path / "d.json.gz", [{"scene_id": 1, "score": 0.5}] * 3
    whole = gzip.compress(json.dumps(content).encode())
    for k in range(len(whole)):
        file.write_bytes(whole[:k] + bytes([whole[k] ^ 0x55]) + whole[k + 1 :])
        with contextlib.suppress(DatasetError):
            assert read_json(file, "") == content


@pytest.mark.parametrize("value", [None, True, "3", 1.5, -1, HUGE, [1], 2**31])
@pytest.mark.parametrize("key", ["scene_id", "image_id", "category_id"])
def test_ids_of_detections(tmp_path: Path, key: str, value: Any) -> None:
    entry = {"scene_id": 1, "image_id": 2, "category_id": 3, "bbox": [0, 0, 1, 1], "score": 0.5, key: value}
    (tmp_path / "d.json").write_text(json.dumps([entry]))
    with pytest.raises(DatasetError, match=rf"d\.json, entry 0, key '{key}': must be (a whole number|from 0 to)"):
        read_detections(tmp_path / "d.json")


@pytest.mark.parametrize("value", [None, True, "3", float("nan"), float("inf"), -HUGE, 1e13, [], [1, 2], {}])
def test_scores_of_detections(tmp_path: Path, value: Any) -> None:
    entry = {"scene_id": 1, "image_id": 2, "category_id": 3, "bbox": [0, 0, 1, 1], "score": value}
    (tmp_path / "d.json").write_text(json.dumps([entry]))
    with pytest.raises(DatasetError, match=r"entry 0, key 'score': (expected 1 numbers|numbers must be finite and at)"):
        read_detections(tmp_path / "d.json")


@pytest.mark.parametrize("field", range(7))
@pytest.mark.parametrize("text", ["", "nan", "1e13", "1_0", "²", "9" * 400, "--1"])
def test_fields_of_results(tmp_path: Path, field: int, text: str) -> None:
    fields = ["1", "2", "3", "0.5", "1 0 0 0 1 0 0 0 1", "0 0 900", "0.1"]
    fields[field] = " ".join([text] * len(fields[field].split()))
    (tmp_path / "r.csv").write_text(f"{HEADER}\n{','.join(fields)}\n")
    name = HEADER.split(",")[field]
    with pytest.raises(DatasetError, match=rf"r\.csv, line 2: {name} must (be|have)"):
        read_results(tmp_path / "r.csv")


@pytest.mark.parametrize("scale", [0, -1, -0.0])
def test_depth_that_has_no_length_is_refused(root: Path, scale: float) -> None:
    _edit(root / "test/000004/scene_camera.json", lambda c: c["0"].update(depth_scale=scale))
    with pytest.raises(
        DatasetError, match=r"image 0, key 'depth_scale': must be above 0, got -?[01]\. It is the length"
    ):
        BopDataset(root).scene(4).frame(0)


@pytest.mark.parametrize("count", [-1, None, 0.5, HUGE])
def test_counts_of_instances(root: Path, count: Any) -> None:
    _edit(root / "test_targets_bop19.json", lambda c: c[0].update(inst_count=count))
    with pytest.raises(DatasetError, match=r"targets_bop19\.json, entry 0, key 'inst_count': must be"):
        BopDataset(root).targets()


@pytest.mark.parametrize("views", [[None], [-1], [0, "1"]])
def test_views_of_targets(root: Path, views: list) -> None:
    _edit(root / "test_targets_bop19.json", lambda c: c[0].update(im_ids=views))
    with pytest.raises(DatasetError, match=r"targets_bop19\.json, entry 0, key 'im_ids': must be"):
        BopDataset(root).targets()


@pytest.mark.parametrize(
    ("file", "change", "expected"),
    [
        ("scene_gt", lambda c: c.update({"0": None}), r"scene_gt\.json, image 0: expected a list, got a NoneType"),
        (
            "scene_gt",
            lambda c: c.update({"0": [3, 3, 3]}),
            r"image 0, instance 0, key 'obj_id': must be a whole number",
        ),
        ("scene_gt_info", lambda c: c.update({"0": {}}), r"scene_gt_info\.json, image 0: expected a list, got a dict"),
        ("scene_gt_info", lambda c: c["0"][0].update(visib_fract=1.5), r"visib_fract .* must be from 0 to 1, got 1\.5"),
        (
            "scene_gt_info",
            lambda c: c["0"][0].update(px_count_visib=-3),
            r"px_count_visib .* must be at least 0, got -3",
        ),
        ("scene_gt", lambda c: c["0"][0].update(cam_t_m2c=[HUGE, 0, 0]), r"'cam_t_m2c': numbers must be finite and at"),
        ("scene_camera", lambda c: c.update({"0": []}), r"scene_camera\.json, image 0: expected an object with cam_K"),
    ],
)
def test_annotations(root: Path, file: str, change, expected: str) -> None:
    _edit(root / f"test/000004/{file}.json", change)
    with pytest.raises(DatasetError, match=re.compile(expected)):
        BopDataset(root).scene(4).truth(0)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"diameter": 0}, r"key 'diameter': must be above 0, got 0\. It is the largest distance"),
        ({"diameter": -5}, r"key 'diameter': must be above 0"),
        ({"symmetries_discrete": 5}, r"symmetries_discrete: expected a list, got a int"),
        ({"symmetries_discrete": [[None] * 16]}, r"symmetries_discrete\[0\]: expected 16 numbers"),
        ({"symmetries_continuous": [3]}, r"symmetries_continuous\[0\]: expected an object"),
        ({"symmetries_continuous": [{"axis": [0, 0, 0], "offset": [0, 0, 0]}]}, r"must have an axis that is not 0"),
        (
            {"symmetries_discrete": [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2]]},
            r"models_info\.json, object 1: symmetries_discrete: discrete symmetries must be rigid motions",
        ),
    ],
)
def test_models_info(root: Path, change: dict, expected: str) -> None:
    for folder in ("models", "models_eval"):
        if (file := root / folder / "models_info.json").is_file():
            _edit(file, lambda c: c["1"].update(change))
    with pytest.raises(DatasetError, match=expected):
        models = BopDataset(root).models
        models.part(1)
        models.diameter_m(1)


def test_results_of_images_that_the_split_lacks(root: Path, tmp_path: Path) -> None:
    dataset, T = BopDataset(root), transform(translation=np.array([0, 0, 0.9]))
    results = [BopResult(scene_id, im_id, 1, 0.5, T, 0.1) for scene_id, im_id in ((4, 0), (4, 9), (5, 0))]
    assert known_results(dataset, results, tmp_path) == results[:1]
    write_results(tmp_path / "r.csv", results[1:])
    with pytest.raises(
        DatasetError,
        match=r"r\.csv: has no line of an image of .*test\. It begins with scene 4, image 9; scenes there: 4",
    ):
        known_results(dataset, read_results(tmp_path / "r.csv"), tmp_path / "r.csv")
