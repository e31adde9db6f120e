"""Detections in the JSON format of BOP and CNOS: a list in COCO's style, with masks as RLE."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from simpick.bop.json_files import read_json, required_id, required_numbers
from simpick.bop.rle import decode_rle, encode_compressed_rle, encode_rle
from simpick.caching import atomic_write_text
from simpick.errors import DatasetError
from simpick.geometry.image_boxes import box_of_mask
from simpick.records import Detection


@dataclass(frozen=True, eq=False)
class BopDetection:
    """One entry of a detections file; its mask is decoded on demand."""

    scene_id: int
    im_id: int
    obj_id: int
    score: float
    box_xyxy_px: Float[np.ndarray, "4"] | None
    """Between pixel edges; None where the file has only a mask."""
    segmentation: dict[str, Any] | None
    """RLE, plain or compressed; None where the file has only a box."""
    time_s: float
    """For the whole image; negative if unknown."""
    where: str
    """File and entry, for errors."""

    def detection(self, part: str, height: int, width: int) -> Detection:
        """Return the detection of `part` in an image of this size.

        A missing box is computed from the mask. Raises `DatasetError` if the mask is of another size.
        """
        mask = None if self.segmentation is None else decode_rle(self.segmentation, height, width, self.where)
        box = self.box_xyxy_px
        if box is None:
            if mask is None or not mask.any():
                raise DatasetError(f"{self.where}: has neither a 'bbox' nor a 'segmentation' with pixels in it.")
            box = box_of_mask(mask)
        return Detection(part, box, mask, self.score)


def read_detections(path: Path) -> list[BopDetection]:
    """Return a file's detections in its order (``.json`` or ``.json.gz``).

    Raises `DatasetError` naming the invalid entry and key.
    """
    entries = read_json(
        path, "Give a detections file in BOP's format: a list of scene_id, image_id, category_id, bbox, score."
    )
    if not isinstance(entries, list):
        raise DatasetError(f"{path}: expected a list of detections, got a {type(entries).__name__}.")
    return parse_detections(entries, path)


def parse_detections(entries: list[Any], path: Path) -> list[BopDetection]:
    """Return the detections of a file's list; `path` names it in errors. Raises `DatasetError`."""
    return [_parse(entry, f"{path}, entry {k}") for k, entry in enumerate(entries)]


def by_image(detections: Iterable[BopDetection]) -> dict[tuple[int, int], list[BopDetection]]:
    """Return detections by scene and image, in their order."""
    found: dict[tuple[int, int], list[BopDetection]] = {}
    for detection in detections:
        found.setdefault((detection.scene_id, detection.im_id), []).append(detection)
    return found


def write_detections(
    path: Path,
    images: Iterable[tuple[int, int, float, Iterable[Detection]]],
    obj_id: Callable[[str], int],
    *,
    compressed: bool = False,
) -> None:
    """Write detections atomically.

    Args:
        path: the JSON file.
        images: per image, the scene's id, the image's id, its time in seconds (negative if unknown) and its detections.
        obj_id: maps a part's name to its object id.
        compressed: write masks as compressed RLE, which is smaller; the plain form is read by the BOP toolkit without
            pycocotools.
    """
    encode = encode_compressed_rle if compressed else encode_rle
    entries = []
    for scene_id, im_id, time_s, detections in images:
        for detection in detections:
            x0, y0, x1, y1 = (float(edge) for edge in detection.box_xyxy_px)
            entry: dict[str, Any] = {"scene_id": scene_id, "image_id": im_id, "category_id": obj_id(detection.part)}
            entry |= {"bbox": [x0, y0, x1 - x0, y1 - y0], "score": float(detection.score), "time": float(time_s)}
            entry["segmentation"] = {} if detection.mask is None else encode(detection.mask)
            entries.append(json.dumps(entry))
    atomic_write_text(path, "[\n" + ",\n".join(entries) + "\n]\n")


def _parse(entry: Any, where: str) -> BopDetection:
    scene_id, im_id, obj_id = (required_id(entry, key, where) for key in ("scene_id", "image_id", "category_id"))
    score = float(required_numbers(entry, "score", 1, where)[0])
    box = None
    if entry.get("bbox"):
        x, y, width, height = required_numbers(entry, "bbox", 4, where)
        if width < 0 or height < 0:
            raise DatasetError(
                f"{where}, key 'bbox': must be x, y, width, height with no negative size, got {entry['bbox']}."
            )
        box = np.array([x, y, x + width, y + height])
    time_s = float(required_numbers(entry, "time", 1, where)[0]) if "time" in entry else -1.0
    segmentation = entry.get("segmentation") or None
    if not isinstance(segmentation, dict | None):
        raise DatasetError(
            f"{where}, key 'segmentation': must be RLE with 'size' and 'counts', got {segmentation!r:.60}; polygons "
            "are not supported."
        )
    return BopDetection(scene_id, im_id, obj_id, score, box, segmentation, time_s, where)
