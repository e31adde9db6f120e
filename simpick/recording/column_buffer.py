"""Gathers many small rows and sends them as columns: one chunk an entity instead of one message a row."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import rerun as rr
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Instant:
    """A point on the recording's timelines."""

    sim_time_s: float
    """Simulated time in seconds."""
    pick: int | None = None
    """Number of the pick; None in recordings that know no picks."""

    @property
    def sim_time_ns(self) -> int:
        """Return the simulated time in whole nanoseconds, as the timeline holds it."""
        return round(self.sim_time_s * 1e9)


def time_columns(instants: list[Instant]) -> list[rr.TimeColumn]:
    """Return the timelines ``sim_time`` and, unless the first instant knows no pick, ``pick``."""
    nanoseconds = np.array([instant.sim_time_ns for instant in instants], "timedelta64[ns]")
    columns = [rr.TimeColumn("sim_time", duration=nanoseconds)]
    if instants[0].pick is not None:
        columns.append(rr.TimeColumn("pick", sequence=[instant.pick or 0 for instant in instants]))
    return columns


@dataclass
class _Transforms:
    instants: list[Instant] = field(default_factory=list)
    frames: list[np.ndarray] = field(default_factory=list)
    poses: list[np.ndarray] = field(default_factory=list)


class ColumnBuffer:
    """Rows of transforms and scalars waiting for `flush`."""

    def __init__(self, stream: rr.RecordingStream, frame_paths: list[str]) -> None:
        self._stream, self._frame_paths = stream, frame_paths
        self._transforms = _Transforms()
        self._scalars: dict[str, tuple[list[Instant], list[float]]] = {}

    def add_transforms(self, instant: Instant, frames: Int[np.ndarray, "n"], poses: Float[np.ndarray, "n 7"]) -> None:
        """Add poses (position in metres, quaternion wxyz) of frames, given by their index in `frame_paths`."""
        self._transforms.instants.append(instant)
        self._transforms.frames.append(frames)
        self._transforms.poses.append(poses)

    def add_scalar(self, instant: Instant, path: str, value: float) -> None:
        """Add one value of a time series."""
        instants, values = self._scalars.setdefault(path, ([], []))
        instants.append(instant)
        values.append(value)

    def flush(self) -> None:
        """Send everything gathered, one chunk an entity."""
        gathered, self._transforms = self._transforms, _Transforms()
        if gathered.frames:
            rows = np.repeat(np.arange(len(gathered.frames)), [len(frames) for frames in gathered.frames])
            frames, poses = np.concatenate(gathered.frames), np.concatenate(gathered.poses).astype(np.float32)
            for frame in np.unique(frames):
                chosen = frames == frame
                self._stream.send_columns(
                    self._frame_paths[frame],
                    time_columns([gathered.instants[row] for row in rows[chosen]]),
                    rr.Transform3D.columns(
                        translation=poses[chosen, :3],
                        # rerun wants xyzw.
                        quaternion=poses[chosen][:, [4, 5, 6, 3]],
                    ),
                    strict=True,
                )
        scalars, self._scalars = self._scalars, {}
        for path, (instants, values) in scalars.items():
            self._stream.send_columns(
                path, time_columns(instants), rr.Scalars.columns(scalars=np.asarray(values)), strict=True
            )
