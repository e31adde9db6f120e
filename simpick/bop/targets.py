"""Lists of the objects to be found: ``test_targets_bop19.json`` and its successors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from simpick.bop.json_files import checked_id, read_json, required_id
from simpick.errors import DatasetError

MIN_VISIBLE_FRACTION = 0.1
"""BOP's targets are instances of which at least this fraction is visible."""


@dataclass(frozen=True)
class BopTarget:
    """One object to be found in one image, or one image in which all objects are to be found."""

    scene_id: int
    im_id: int
    obj_id: int | None
    """None in lists of the detection task (BOP 2024), which name images only."""
    inst_count: int | None
    """Number of instances to be found; None where the list does not state it."""


def read_targets(path: Path) -> tuple[BopTarget, ...]:
    """Return the targets in the file's order; lists of several views (``im_ids``) become one target per view."""
    entries = read_json(path, "Use the annotations themselves as targets, or fetch the data set's base archive.")
    if not isinstance(entries, list):
        raise DatasetError(f"{path}: expected a list of targets, got a {type(entries).__name__}.")
    targets = []
    for k, entry in enumerate(entries):
        where = f"{path}, entry {k}"
        views = entry.get("im_ids") if isinstance(entry, dict) else None
        if isinstance(views, list):
            im_ids = [checked_id(view, f"{where}, key 'im_ids'") for view in views]
        else:
            im_ids = [required_id(entry, "im_id", where)]
        scene_id = required_id(entry, "scene_id", where)
        obj_id = required_id(entry, "obj_id", where) if "obj_id" in entry else None
        count = required_id(entry, "inst_count", where) if "inst_count" in entry else None
        targets += [BopTarget(scene_id, im_id, obj_id, count) for im_id in im_ids]
    return tuple(targets)
