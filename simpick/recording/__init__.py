"""Recording: the `Recorder` protocol, a recorder that does nothing, and one that writes rerun recordings.

`RerunRecorder`, `MujocoLogger`, `log_mujoco_model`, `metrics_from_rrd` and `properties_from_rrd` load rerun when they
are first asked for; `Recorder` and `NullRecorder` never do.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from simpick.recording.base import NullRecorder as NullRecorder
from simpick.recording.base import Recorder as Recorder

if TYPE_CHECKING:
    from simpick.recording.column_buffer import Instant as Instant
    from simpick.recording.mujoco_logger import MujocoLogger as MujocoLogger
    from simpick.recording.mujoco_logger import log_mujoco_model as log_mujoco_model
    from simpick.recording.read_back import metrics_from_rrd as metrics_from_rrd
    from simpick.recording.read_back import properties_from_rrd as properties_from_rrd
    from simpick.recording.rerun_recorder import RerunRecorder as RerunRecorder

_LAZY = {
    "Instant": "column_buffer",
    "MujocoLogger": "mujoco_logger",
    "log_mujoco_model": "mujoco_logger",
    "metrics_from_rrd": "read_back",
    "properties_from_rrd": "read_back",
    "RerunRecorder": "rerun_recorder",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
