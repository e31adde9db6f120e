"""Layout of a `PickRecord` and a configuration in a recording: entities, components and types."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import rerun as rr

from simpick.records import PickOutcome, PickRecord, PoseError

RECORD_PATH = "/pick/record"
"""Entity with the fields of a record that are not plotted, one component per field."""
OUTCOME_PATH = "/pick/outcome"
"""Entity whose state is the outcome, from the pick's beginning on."""
POSE_ERROR_PATHS: Mapping[str, str] = {name: f"/pose_error/{name}" for name in PoseError.__dataclass_fields__}
"""Entity of each field of `PoseError`; a pick without an estimate has no rows there."""
LATENCY_ROOT = "/latency"
PROPERTIES_ROOT = "/__properties"
_LISTS: Mapping[object, pa.DataType] = {
    str: pa.string(),
    str | None: pa.string(),
    int | None: pa.int64(),
    tuple[int, ...]: pa.int64(),
    tuple[str, ...]: pa.string(),
}
"""Arrow type of the list that holds a field of this annotation; None is an empty list."""
_ELSEWHERE = ("pick", "outcome", "pose_error", "timings_s")
_FIELDS = {name: kind for name, kind in get_type_hints(PickRecord).items() if name not in _ELSEWHERE}
SCALAR_PATHS: Mapping[str, str] = {name: f"/score/{name}" for name, kind in _FIELDS.items() if kind in (int, float)}
"""Entity of each numeric field of a `PickRecord`."""
RECORD_FIELDS: Mapping[str, pa.DataType] = {
    name: _LISTS[kind] for name, kind in _FIELDS.items() if name not in SCALAR_PATHS
}
"""Arrow type of each component at `RECORD_PATH`."""


def record_from_columns(
    pick: int,
    outcome: str,
    numbers: Mapping[str, float],
    lists: Mapping[str, list[Any]],
    pose_error: PoseError | None,
    timings_s: dict[str, float],
) -> PickRecord:
    """Return the record whose fields were read from `SCALAR_PATHS` and `RECORD_PATH`."""
    fields: dict[str, Any] = {name: _FIELDS[name](value) for name, value in numbers.items()}
    for name, values in lists.items():
        is_tuple = get_origin(_FIELDS[name]) is tuple
        fields[name] = tuple(values) if is_tuple else values[0] if values else None
    return PickRecord(pick=pick, outcome=PickOutcome(outcome), pose_error=pose_error, timings_s=timings_s, **fields)


def log_pick_record(stream: rr.RecordingStream, record: PickRecord, *, timings: bool) -> None:
    """Log a record at the stream's present time."""
    fields = {}
    for name, kind in RECORD_FIELDS.items():
        value = getattr(record, name)
        values = list(value) if isinstance(value, tuple) else [] if value is None else [value]
        fields[name] = pa.array(values, kind)
    stream.log(RECORD_PATH, [_column(name, values) for name, values in fields.items()], strict=True)
    for name, path in SCALAR_PATHS.items():
        stream.log(path, rr.Scalars(float(getattr(record, name))), strict=True)
    if record.pose_error is not None:
        for name, path in POSE_ERROR_PATHS.items():
            stream.log(path, rr.Scalars(float(getattr(record.pose_error, name))), strict=True)
    if timings:
        for name, seconds in record.timings_s.items():
            path = f"{LATENCY_ROOT}/{rr.escape_entity_path_part(name)}"
            stream.log(path, rr.Scalars(float(seconds)), strict=True)


def log_properties(stream: rr.RecordingStream, name: str, values: Mapping[str, object]) -> None:
    """Log a mapping as the recording property `name`.

    Numbers and texts stand as they are, inner mappings as ``outer.inner``, all else as JSON.
    """
    columns = [_column(key, _property_array(value)) for key, value in _flat(values).items()]
    if columns:
        rr.send_property(name, columns, recording=stream)


def _flat(values: Mapping[str, object]) -> dict[str, object]:
    flat: dict[str, object] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat |= {f"{key}.{inner}": leaf for inner, leaf in _flat(value).items()}
        else:
            flat[key] = value
    return flat


def _property_array(value: object) -> pa.Array:
    plain = value.item() if isinstance(value, np.generic) else value
    return pa.array([plain if isinstance(plain, bool | int | float | str) else json.dumps(plain, default=str)])


class _ArrowComponent:
    """A component batch of an Arrow array, typed also when it is empty."""

    def __init__(self, values: pa.Array) -> None:
        self._values = values

    def as_arrow_array(self) -> pa.Array:
        return self._values


def _column(name: str, values: pa.Array) -> rr.DescribedComponentBatch:
    return rr.DescribedComponentBatch(_ArrowComponent(values), rr.ComponentDescriptor(name))
