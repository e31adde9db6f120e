"""Detections of simulated bins from a file in BOP's format: its scene is the bin's seed, its image 0."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from simpick.bop.detections_json import BopDetection, by_image, read_detections
from simpick.errors import DatasetError
from simpick.pose_eval.bin_images import BinView
from simpick.records import Detection


def detections_of_bin(file: Path, view: BinView, part_names: Sequence[str]) -> list[Detection]:
    """Return a file's detections of the parts in a bin, best first; category k is the k-th of `part_names`, from 1.

    Raises:
        DatasetError: the file cannot be read, or an entry has no such category or a mask of another size.
    """
    height, width = view.frame.rgb.shape[:2]
    present = {part.name for part in view.parts}
    found = []
    for entry in _read(file).get((view.seed, 0), []):
        if not 1 <= entry.obj_id <= len(part_names):
            raise DatasetError(
                f"{entry.where}, key 'category_id': must be from 1 to {len(part_names)}, the number of a part among "
                f"{', '.join(part_names)}; got {entry.obj_id}"
            )
        if (name := part_names[entry.obj_id - 1]) in present:
            found.append(entry.detection(name, height, width))
    return sorted(found, key=lambda detection: -detection.score)


def check_covers(file: Path, seeds: Sequence[int]) -> None:
    """Raise DatasetError unless a file has detections of at least one of these bins."""
    scenes = {scene for scene, image in _read(file) if image == 0}
    if not scenes & set(seeds):
        raise DatasetError(
            f"{file} must hold detections of the bins: scene_id {seeds[0]} and so on, a bin's seed, and image_id 0; "
            f"it holds scenes {', '.join(map(str, sorted(scenes)[:5])) or 'none'}. Write the images with --export, and "
            "number the detections as they are"
        )


@lru_cache(maxsize=4)
def _read(file: Path) -> dict[tuple[int, int], list[BopDetection]]:
    return by_image(read_detections(file))
