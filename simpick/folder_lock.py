"""A lock on a folder that one process writes, which names its holder to the others."""

from __future__ import annotations

import json
import os
import platform
import sys
import time
import weakref
from pathlib import Path

from filelock import FileLock, Timeout

from simpick.errors import OutputError
from simpick.json_text import load_json

LOCK_FILE = ".lock"
"""The file stays when the lock is released. However a process ends, the operating system releases its locks."""


def lock_folder(path: Path, holder: object) -> None:
    """Lock a folder for this process for as long as `holder` lives; further holders in this process share the lock.

    Raises:
        OutputError: another process holds it; the message names that process.
        OSError: the lock's file cannot be written.
    """
    file = path.resolve() / LOCK_FILE
    lock = FileLock(file, is_singleton=True, thread_local=False)
    is_first = not lock.is_locked
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        raise OutputError(
            f"{path} is being written by {_named(file)}. Wait until it has finished, or choose another folder with "
            "--out"
        ) from error
    # At exit the operating system does it, and a forked child must not.
    weakref.finalize(holder, lock.release).atexit = False
    if is_first:
        command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])[:200] if sys.argv else ""
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        owner = {"pid": os.getpid(), "host": platform.node(), "since": since, "command": command}
        file.write_text(json.dumps(owner) + "\n")


def _named(file: Path) -> str:
    """Return the holder of a lock in words."""
    try:
        owner = load_json(file.read_bytes())
        return f"process {owner['pid']} on {owner['host']} since {owner['since']} ({owner['command']})"
    # Windows does not let others read a locked file; and the holder may not have written its name yet.
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"
