"""A recording on disk that is whole on every exit: close, exception, interpreter exit, Ctrl-C or SIGTERM."""

from __future__ import annotations

import atexit
import os
import signal
import threading
from pathlib import Path
from types import FrameType

import rerun as rr

from simpick.errors import ConfigError, OutputError

APPLICATION_ID = "simpick"
ROOM_BYTES = 8 * 1024 * 1024
"""What `RecordingFile.require_room` asks for: several times what one pick adds."""
_PATIENCE_S = 60.0


class RecordingFile:
    """Reserves a path, streams to ``<path>.partial``, and moves it into place when closed.

    What bears the name ``*.rrd`` is therefore always complete, footer and all; a process killed outright (SIGKILL,
    power) leaves only the partial file, which the next attempt overwrites.
    """

    def __init__(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Reserve `path`. Raises `ConfigError` for a wrong suffix and `OutputError` where nothing can be written."""
        self.path = Path(path)
        if self.path.suffix != ".rrd":
            raise ConfigError(f"a recording's name must end in .rrd, got {self.path}; rename it to {self.path}.rrd")
        if self.path.exists() and not overwrite:
            raise OutputError(f"cannot record to {self.path}: it exists already; choose another name or delete it")
        self._partial = self.path.with_name(self.path.name + ".partial")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._partial.write_bytes(b"")
        except OSError as error:
            raise OutputError(
                f"cannot record to {self.path}: {error.strerror or error}; choose a folder that you may write to"
            ) from error
        self._stream: rr.RecordingStream | None = None
        self._closed = False
        _watch(self)

    def open(self, recording_id: str, *, serve_port: int | None = None) -> rr.RecordingStream:
        """Start the recording; `serve_port` also serves it, to this machine only. Raises `OutputError` without room."""
        self.require_room()
        stream = rr.RecordingStream(
            APPLICATION_ID,
            recording_id=recording_id,
            # The properties that rerun would send hold the time of day; two runs of one seed must be equal.
            send_properties=False,
            # For the same reason chunks end where `flush` is called, not where a timer happens to strike.
            batcher_config=rr.ChunkBatcherConfig.NEVER(),
        )
        if not stream.is_enabled():
            raise ConfigError("recording is switched off by the environment variable RERUN; unset it to record")
        rr.set_log_time_enabled(False, recording=stream)
        sinks: list[rr.FileSink | rr.GrpcServerSink] = [rr.FileSink(self._partial)]
        if serve_port is not None:
            sinks.append(rr.GrpcServerSink("127.0.0.1", serve_port))
        stream.set_sinks(*sinks)
        self._stream = stream
        return stream

    def close(self) -> None:
        """Write what is pending and the footer, and give the file its name. A second call does nothing.

        Raises:
            OutputError: the disk did not take it; only the partial file is left.
        """
        if self._closed:
            return
        self._closed = True
        _forget(self)
        if self._stream is None:
            self._partial.unlink(missing_ok=True)
            return
        try:
            self._stream.flush(timeout_sec=_PATIENCE_S)
        except RuntimeError as error:
            # Disconnecting would wait again, and without an end.
            raise OutputError(_no_room(self.path, f"not written within {_PATIENCE_S:g} s")) from error
        self._stream.disconnect()
        self._stream = None
        self._partial.replace(self.path)

    def require_room(self) -> None:
        """Check that the disk takes `ROOM_BYTES` more, by writing them beside the recording and deleting them.

        To be called before much is recorded: rerun writes from its own thread, which reports no failure,
        and waiting for it then has no end.

        Raises:
            OutputError: the disk is full, or a quota or limit is reached.
        """
        probe = self.path.with_name(self.path.name + ".room")
        try:
            probe.write_bytes(bytes(ROOM_BYTES))
        except OSError as error:
            raise OutputError(_no_room(self.path, error.strerror or str(error))) from error
        finally:
            probe.unlink(missing_ok=True)


def _no_room(path: Path, reason: str) -> str:
    return (
        f"cannot record to {path}: {reason}. What was finished before is kept: make room and run the same command "
        "again to continue, or leave out --record"
    )


_open_files: list[RecordingFile] = []
_owner_pid: int | None = None
_sigterm_is_ours = False


def _watch(file: RecordingFile) -> None:
    global _owner_pid, _sigterm_is_ours
    if _owner_pid != os.getpid():
        # A forked child inherits the list, but the files in it are the parent's to close.
        _open_files.clear()
        _owner_pid = os.getpid()
    _open_files.append(file)
    # Only where nothing else handles SIGTERM: its default would end the process without any clean-up.
    in_main_thread = threading.current_thread() is threading.main_thread()
    if in_main_thread and signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _close_and_terminate)
        _sigterm_is_ours = True


def _forget(file: RecordingFile) -> None:
    global _sigterm_is_ours
    if file in _open_files:
        _open_files.remove(file)
    in_main_thread = threading.current_thread() is threading.main_thread()
    if not _open_files and _sigterm_is_ours and in_main_thread:
        if signal.getsignal(signal.SIGTERM) is _close_and_terminate:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
        _sigterm_is_ours = False


@atexit.register
def _close_all() -> None:
    if _owner_pid == os.getpid():
        for file in tuple(_open_files):  # Closing takes a file out of the list.
            file.close()


def _close_and_terminate(signum: int, frame: FrameType | None) -> None:
    _close_all()
    # Die of the signal itself, so that the parent process sees the true cause.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGTERM)
