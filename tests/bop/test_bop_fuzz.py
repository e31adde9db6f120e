"""Whatever a file of a data set holds, its reader returns checked values or raises `DatasetError` with its name."""

from __future__ import annotations

import gzip
import json
import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simpick.bop import BopDataset, read_detections, read_results
from simpick.bop.results_csv import HEADER
from simpick.bop.rle import encode_compressed_rle, encode_rle
from simpick.bop.targets import read_targets
from simpick.errors import DatasetError
from tests.damage import FUZZ, damaged_bytes, damaged_value, refusing, restored

MASK = np.zeros((4, 6), bool)
MASK[1:3, 2:5] = True
DETECTIONS = [
    {
        "scene_id": 1,
        "image_id": 2,
        "category_id": 3,
        "bbox": [2, 1, 3, 2],
        "score": 0.5,
        "time": 0.1,
        "segmentation": rle,
    }
    for rle in (encode_rle(MASK), encode_compressed_rle(MASK), {})
]
TARGETS = [{"scene_id": 1, "im_id": 2, "obj_id": 3, "inst_count": 4}, {"scene_id": 1, "im_ids": [1, 2], "obj_id": 3}]
RESULTS = f"{HEADER}\n1,2,3,0.5,1 0 0 0 1 0 0 0 1,0 0 900,0.1\n1,2,3,0.25,1 0 0 0 1 0 0 0 1,0 0 0,0.1\n"


def are_ids(*values: Any) -> bool:
    return all(type(value) is int and 0 <= value < 2**31 for value in values)


def check_detections(file: Path) -> None:
    with refusing(DatasetError, file.name):
        for entry in read_detections(file):
            assert are_ids(entry.scene_id, entry.im_id, entry.obj_id) and math.isfinite(entry.score)
            with refusing(DatasetError, file.name):
                assert np.isfinite(entry.detection("part", *MASK.shape).box_xyxy_px).all()


@FUZZ
@given(value=damaged_value(DETECTIONS))
def test_detections(tmp_path: Path, value: Any) -> None:
    (tmp_path / "d.json").write_text(json.dumps(value))
    check_detections(tmp_path / "d.json")


@FUZZ
@given(content=damaged_bytes(gzip.compress(json.dumps(DETECTIONS).encode(), mtime=0)))
def test_zipped_detections(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "d.json.gz").write_bytes(content)
    check_detections(tmp_path / "d.json.gz")


@FUZZ
@given(value=damaged_value(TARGETS))
def test_targets(tmp_path: Path, value: Any) -> None:
    file = tmp_path / "targets.json"
    file.write_text(json.dumps(value))
    with refusing(DatasetError, file.name):
        for t in read_targets(file):
            assert are_ids(t.scene_id, t.im_id, *(x for x in (t.obj_id, t.inst_count) if x is not None))


@FUZZ
@given(content=damaged_bytes(RESULTS.encode()))
def test_results(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "results.csv"
    file.write_bytes(content)
    with refusing(DatasetError, file.name):
        for result in read_results(file):
            assert are_ids(result.scene_id, result.im_id, result.obj_id)
            assert np.isfinite(result.T_camera_model).all() and math.isfinite(result.score)


@pytest.mark.parametrize("name", ["scene_camera", "scene_gt", "scene_gt_info"])
@FUZZ
@given(data=st.data())
def test_annotations(root: Path, name: str, data: st.DataObject) -> None:
    file = root / f"test/000004/{name}.json"
    with restored(file) as whole, refusing(DatasetError, "scene_", "mask", "models_info"):
        file.write_text(json.dumps(data.draw(damaged_value(json.loads(whole)))))
        scene = BopDataset(root).scene(4)
        for im_id in scene:
            for read in (scene.frame, scene.truth, scene.detections, partial(scene.boxes, kind="bbox_visib")):
                read(im_id)


@FUZZ
@given(data=st.data())
def test_models_info(root: Path, data: st.DataObject) -> None:
    file = root / "models/models_info.json"
    with restored(file) as whole, refusing(DatasetError, "models_info", "obj_0000"):
        file.write_text(json.dumps(data.draw(damaged_value(json.loads(whole)))))
        models = BopDataset(root).models
        for obj_id in models.obj_ids:
            models.part(obj_id)
            models.diameter_m(obj_id)


@pytest.mark.parametrize(
    "name", ["test/000004/rgb/000000.png", "test/000004/depth/000000.png", "models/obj_000001.ply"]
)
@FUZZ
@given(data=st.data())
def test_images_and_models(root: Path, name: str, data: st.DataObject) -> None:
    file = root / name
    with restored(file) as whole, refusing(DatasetError, file.name, "scene_camera"):
        file.write_bytes(data.draw(damaged_bytes(whole)))
        dataset = BopDataset(root)
        dataset.scene(4).frame(0)
        dataset.models.part(1)
