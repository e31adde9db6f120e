import gzip
import json

import numpy as np
import pytest

from simpick.bop import BopDataset, read_detections, write_detections
from simpick.errors import DatasetError

ENTRY = {"scene_id": 4, "image_id": 0, "category_id": 2, "bbox": [3, 4, 10, 20], "score": 0.7, "time": 0.25}


def _file(tmp_path, *entries):
    path = tmp_path / "detections.json"
    path.write_text(json.dumps(entries))
    return path


def test_boxes_become_corners_and_masks_are_optional(tmp_path):
    (found,) = read_detections(_file(tmp_path, ENTRY | {"segmentation": {}}))
    assert (found.scene_id, found.im_id, found.obj_id, found.score, found.time_s) == (4, 0, 2, 0.7, 0.25)
    detection = found.detection("rod", 48, 64)
    np.testing.assert_array_equal(detection.box_xyxy_px, [3, 4, 13, 24])
    assert detection.mask is None


def test_a_missing_box_is_taken_from_the_mask(tmp_path):
    counts = [48 * 2 + 5, 3, 45, 3, 48 * 61 - 8]  # rows 5 to 7 of columns 2 and 3
    entry = ENTRY | {"bbox": [], "segmentation": {"size": [48, 64], "counts": counts}}
    detection = read_detections(_file(tmp_path, entry))[0].detection("rod", 48, 64)
    np.testing.assert_array_equal(detection.box_xyxy_px, [2, 5, 4, 8])
    assert detection.mask is not None and detection.mask.sum() == 6


@pytest.mark.parametrize("compressed", [False, True])
def test_detections_come_back_unchanged(tmp_path, root, compressed):
    dataset = BopDataset(root)
    detections = [
        d.__class__(d.part, d.box_xyxy_px, d.mask, 0.25 + 0.5 * k) for k, d in enumerate(dataset.scene(4).detections(0))
    ]
    path = tmp_path / "found.json"
    write_detections(path, [(4, 0, 0.1, detections), (4, 1, 0.1, [])], dataset.models.obj_id, compressed=compressed)
    found = read_detections(path)
    assert {(d.scene_id, d.im_id) for d in found} == {(4, 0)}
    read = [d.detection(dataset.models.name(d.obj_id), 48, 64) for d in found]
    assert [(d.part, d.score) for d in read] == [("block", 0.25), ("rod", 0.75)]
    for new, old in zip(read, detections, strict=True):
        np.testing.assert_array_equal(new.mask, old.mask)
        np.testing.assert_array_equal(new.box_xyxy_px, old.box_xyxy_px)


def test_gzipped_files_are_read(tmp_path):
    path = tmp_path / "detections.json.gz"
    path.write_bytes(gzip.compress(json.dumps([ENTRY]).encode()))
    assert len(read_detections(path)) == 1


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"category_id": "2"}, r"detections\.json, entry 1, key 'category_id': must be a whole number, got '2'"),
        ({"score": None}, r"entry 1, key 'score': expected 1 numbers, got None"),
        ({"bbox": [1, 2, 3]}, r"entry 1, key 'bbox': expected 4 numbers, got 3"),
        ({"bbox": [9, 9, -3, 4]}, r"entry 1, key 'bbox': must be x, y, width, height with no negative size"),
    ],
)
def test_bad_entries_are_named(tmp_path, change, text):
    with pytest.raises(DatasetError, match=text):
        read_detections(_file(tmp_path, ENTRY, ENTRY | change))


def test_a_mask_of_another_size_names_the_entry(tmp_path):
    entry = ENTRY | {"segmentation": {"size": [24, 32], "counts": [768]}}
    with pytest.raises(DatasetError, match=r"entry 0: the RLE's size is \[24, 32\], but the image's is \[48, 64\]"):
        read_detections(_file(tmp_path, entry))[0].detection("rod", 48, 64)


def test_annotations_instead_of_a_list_are_refused(tmp_path):
    path = tmp_path / "coco.json"
    path.write_text('{"images": [], "annotations": []}')
    with pytest.raises(DatasetError, match=r"coco\.json: expected a list of detections, got a dict"):
        read_detections(path)
