"""Reading a recording back: the pick table from the ``.rrd`` alone."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import RrdReader

from simpick.errors import DatasetError
from simpick.recording.pick_columns import (
    LATENCY_ROOT,
    OUTCOME_PATH,
    POSE_ERROR_PATHS,
    PROPERTIES_ROOT,
    RECORD_FIELDS,
    RECORD_PATH,
    SCALAR_PATHS,
    record_from_columns,
)
from simpick.records import PickRecord, PoseError

_SCALARS = "Scalars:scalars"
_TABLE_ROOTS = ("/pick/", "/pose_error/", "/score/", f"{LATENCY_ROOT}/")


def metrics_from_rrd(path: str | os.PathLike[str]) -> list[PickRecord]:
    """Return the records of all picks, in order, recomputed from a recording's plots, states and record columns.

    They equal the records that were given to `RerunRecorder.end_pick`; `PickRecord.timings_s` is empty unless the
    recording was made with ``record_timings=True``. Raises `DatasetError` for a file that is no such recording.
    """
    values: dict[str, dict[int, Any]] = {}
    for entity, batch in _chunks(path):
        if not entity.startswith(_TABLE_ROOTS) or "pick" not in batch.schema.names:
            continue
        picks = batch.column("pick").to_pylist()
        for component in batch.schema.names:
            column = batch.column(component)
            if pa.types.is_list(column.type) or pa.types.is_large_list(column.type):
                cells = zip(picks, column.to_pylist(), strict=True)
                known = {pick: cell for pick, cell in cells if cell is not None and _is_known(entity, cell)}
                values.setdefault(f"{entity}|{component}", {}).update(known)

    def scalar(entity: str, pick: int) -> float | None:
        cell = values.get(f"{entity}|{_SCALARS}", {}).get(pick)
        return None if cell is None else float(cell[0])

    outcomes = values.get(f"{OUTCOME_PATH}|StateChange:state", {})
    fields = {name: values.get(f"{RECORD_PATH}|{name}", {}) for name in RECORD_FIELDS}
    latencies = {key.split("|")[0]: cells for key, cells in values.items() if key.startswith(f"{LATENCY_ROOT}/")}
    records = []
    for pick in sorted(outcomes):
        errors = {name: scalar(entity, pick) for name, entity in POSE_ERROR_PATHS.items()}
        numbers = {name: scalar(entity, pick) for name, entity in SCALAR_PATHS.items()}
        known = {name: value for name, value in numbers.items() if value is not None}
        if len(known) < len(numbers) or any(pick not in cells for cells in fields.values()):
            raise DatasetError(f"{path}: pick {pick} is incomplete; was the recording made by another version?")
        found = {name: value for name, value in errors.items() if value is not None}
        timings_s = {
            _unescaped(entity.removeprefix(f"{LATENCY_ROOT}/")): float(cells[pick][0])
            for entity, cells in latencies.items()
            if pick in cells
        }
        records.append(
            record_from_columns(
                pick,
                outcomes[pick][0],
                known,
                {name: cells[pick] for name, cells in fields.items()},
                PoseError(**found) if len(found) == len(errors) else None,
                timings_s,
            )
        )
    return records


def properties_from_rrd(path: str | os.PathLike[str], name: str = "config") -> dict[str, Any]:
    """Return a recording property (``config`` or ``summary``) as it was logged, nested values as JSON text."""
    found: dict[str, Any] = {}
    for entity, batch in _chunks(path):
        if entity == f"{PROPERTIES_ROOT}/{name}":
            for component in batch.schema.names:
                cell = batch.column(component).to_pylist()[-1]
                if isinstance(cell, list):
                    found[component] = cell[0]
    return found


def _is_known(entity: str, cell: list[Any]) -> bool:
    # A pick's beginning leaves an empty state until its outcome is known.
    return entity != OUTCOME_PATH or cell != [""]


def _chunks(path: str | os.PathLike[str]) -> Iterator[tuple[str, pa.RecordBatch]]:
    if not Path(path).is_file():
        raise DatasetError(f"{path}: no such recording")
    try:
        for chunk in RrdReader(Path(path)).stream():
            yield chunk.entity_path, chunk.to_record_batch()
    except (ValueError, RuntimeError, OSError) as error:
        raise DatasetError(f"{path}: not a readable rerun recording ({error})") from error


def _unescaped(part: str) -> str:
    """Undo rerun's escaping of one path part: a backslash makes the next character plain."""
    return re.sub(r"\\(.)", r"\1", part, flags=re.DOTALL)
