"""Detections that the user provides: boxes as numbers, or a JSON file by image name or in BOP's format.

By image name::

    {"photo.jpg": [{"part": "clamp", "box": [x1, y1, x2, y2], "mask": "clamp_mask.png", "score": 0.9}]}

``part`` may be left out where only one is asked for, ``score`` (1) and either of ``box`` and ``mask`` always. Masks are
image files, relative to the JSON file, or RLE. In BOP's format (a list, as CNOS writes it) ``image_id`` is the number
at the end of the image's file name and ``category_id`` the part's number in the order given, from 1. Boxes and masks
are those of the original image, before it is undistorted.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from simpick.bop.detections_json import BopDetection, parse_detections
from simpick.bop.images import read_mask
from simpick.bop.json_files import numbers, read_json
from simpick.bop.rle import decode_rle
from simpick.errors import DatasetError
from simpick.geometry import box_of_mask
from simpick.photos.image_files import ImageFile
from simpick.records import Detection


def boxes_from_numbers(values: Sequence[float], part: str) -> list[Detection]:
    """Return a detection of the part for each four numbers x1, y1, x2, y2, between pixel edges.

    Raises:
        DatasetError: they are not a multiple of four, or a box has no area.
    """
    if len(values) % 4 or not values:
        raise DatasetError(f"boxes must be X1 Y1 X2 Y2 in pixels, four numbers each, got {len(values)} numbers")
    boxes = np.asarray(values, float).reshape(-1, 4)
    for box in boxes:
        _check_box(box, "boxes")
    return [Detection(part, box, None, 1.0) for box in boxes]


class DetectionFile:
    """The detections of a JSON file, by image."""

    def __init__(self, path: Path, parts: Sequence[str]) -> None:
        """Read the file; `parts` are the names of those asked for, in their order."""
        content = read_json(path, "Give a detections file, or boxes as numbers: --boxes X1 Y1 X2 Y2.")
        self._path, self._parts = path, list(parts)
        self._by_name: dict[str, list[Any]] = {}
        self._by_id: dict[int, list[BopDetection]] = {}
        self.note = ""
        """A sentence about entries that are left out; empty if there are none."""
        if isinstance(content, list):
            entries = parse_detections(content, path)
            for entry in entries:
                self._by_id.setdefault(entry.im_id, []).append(entry)
            unknown = {entry.obj_id for entry in entries} - set(range(1, len(parts) + 1))
            if unknown:
                count = sum(entry.obj_id in unknown for entry in entries)
                numbered = ", ".join(f"{k} {name}" for k, name in enumerate(parts, 1))
                self.note = (
                    f"{count} of {len(entries)} detections in {path} are left out: category_id must be the number of a "
                    f"part in the order of --part ({numbered}), got {', '.join(map(str, sorted(unknown)))}"
                )
        elif isinstance(content, dict) and all(isinstance(value, list) for value in content.values()):
            self._by_name = content
        else:
            raise DatasetError(f'{path}: must hold {{"image.png": [...]}} or a list in BOP\'s format')

    def of(self, image: ImageFile, height: int, width: int) -> list[Detection]:
        """Return the detections of an image of this size; none if the file does not list it.

        Raises:
            DatasetError: an entry of the image is invalid, or names a part that was not asked for.
        """
        if self._by_id:
            number = re.search(r"(\d+)$", image.name)
            entries = self._by_id.get(int(number[1]), []) if number else []
            known = [e for e in entries if 1 <= e.obj_id <= len(self._parts)]
            return [e.detection(self._parts[e.obj_id - 1], height, width) for e in known]
        key = next((key for key in (image.path.name, image.name, str(image.path)) if key in self._by_name), None)
        entries = self._by_name[key] if key is not None else []
        return [self._parse(e, height, width, f"{self._path}, {key!r}, entry {k}") for k, e in enumerate(entries)]

    def _parse(self, entry: Any, height: int, width: int, where: str) -> Detection:
        box = numbers(entry, "box", 4, where)
        part = entry.get("part", self._parts[0] if len(self._parts) == 1 else None)
        if part not in self._parts:
            raise DatasetError(f"{where}, key 'part': must be one of {', '.join(self._parts)}, got {part!r}.")
        mask = self._mask(entry, height, width, where)
        if box is None:
            if mask is None or not mask.any():
                raise DatasetError(f"{where}: has neither a 'box' nor a 'mask' with pixels in it.")
            box = box_of_mask(mask)
        _check_box(box, where)
        score = numbers(entry, "score", 1, where)
        return Detection(part, box, mask, 1.0 if score is None else float(np.clip(score[0], 0, 1)))

    def _mask(
        self, entry: Mapping[str, Any], height: int, width: int, where: str
    ) -> Bool[np.ndarray, "height width"] | None:
        given = entry.get("mask")
        if given is None:
            return None
        if isinstance(given, dict):
            return decode_rle(given, height, width, where)
        mask = read_mask(self._path.parent / str(given))
        if mask.shape != (height, width):
            raise DatasetError(
                f"{where}: the mask must have the image's size {width} x {height} px, got {mask.shape[1]} x "
                f"{mask.shape[0]}."
            )
        return mask


def _check_box(box: np.ndarray, where: str) -> None:
    if not (np.isfinite(box).all() and box[2] > box[0] and box[3] > box[1]):
        raise DatasetError(f"{where}: a box must be x1, y1, x2, y2 with x2 > x1 and y2 > y1, got {box.tolist()}.")
