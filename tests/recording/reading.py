"""Reading recordings in tests, apart from the code under test."""

from rerun.chunk import RrdReader


def chunks(path):
    return list(RrdReader(path).stream())


def entities(path):
    return {chunk.entity_path for chunk in chunks(path)}


def series(path, entity, component):
    """Return times (s) and cells of one component, in order of time."""
    rows = []
    for chunk in chunks(path):
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and component in batch.schema.names:
            times = batch.column("sim_time").cast("int64").to_pylist()
            rows += zip(times, batch.column(component).to_pylist(), strict=True)
    rows = sorted((row for row in rows if row[1] is not None), key=lambda row: row[0])
    return [time * 1e-9 for time, _ in rows], [cell for _, cell in rows]
