"""`RunFolder`: a folder with the results of one configuration, where a run that was stopped resumes."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from simpick.caching import atomic_path, atomic_write_text
from simpick.errors import OutputError
from simpick.folder_lock import LOCK_FILE, lock_folder
from simpick.json_text import load_json

CONFIG_FILE = "config.json"


def differences(before: Any, now: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """Yield the keys that lead to each value that differs, and both values; None stands for a missing one."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted(before.keys() | now.keys()):
            yield from differences(before.get(key), now.get(key), (*path, key))
    elif before != now:
        yield path, before, now


def describe(name: str, before: Any, now: Any) -> str:
    """Return a difference in words: ``seed (0 there, 1 now)``."""
    there, here = ("none" if value is None else repr(value) for value in (before, now))
    return f"{name} ({there} there, {here} now)"


def all_changes(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return every difference in words, by the dotted name of the setting."""
    return [describe(".".join(path), *values) for path, *values in differences(before, now)]


class RunFolder:
    """A folder whose files all follow from one provenance, which a JSON file in it states.

    One process at a time writes it: the folder is locked for as long as the object lives.
    """

    def __init__(
        self,
        path: Path,
        provenance: dict[str, Any] | None,
        *,
        config_file: str = CONFIG_FILE,
        results: Sequence[str] = (),
        changes: Callable[[dict[str, Any], dict[str, Any]], list[str]] = all_changes,
        overwrite: bool | None = None,
        is_owner: bool = True,
    ) -> None:
        """Open a folder, made if missing.

        Args:
            path: The folder.
            provenance: What the results depend on, as plain values; None for a run that cannot be resumed.
            config_file: Name of the file that states the provenance.
            results: Patterns of the other files that a run of this kind leaves here.
            changes: Returns what forbids to resume, in words, from the provenance found and the one given.
            overwrite: Replace the files of an earlier run; they are deleted when the first new one is written. None for
                a command that has no such option.
            is_owner: Whether this process writes; others of the same run only compare the provenance.

        Raises:
            OutputError: the folder cannot be written, another process writes it, or it holds other files or results
                of another provenance.
        """
        self.path = path
        self.provenance: dict[str, Any] = json.loads(json.dumps(provenance or {}))
        """As the configuration file states it."""
        file = path / config_file
        remedy = "Choose another folder with --out" + (", or --overwrite to replace them" * (overwrite is not None))
        try:
            path.mkdir(parents=True, exist_ok=True)
            if is_owner and not file.exists():
                self._refuse_other_files()
            if is_owner:
                lock_folder(path, self)
            self._replaced = _identities(path, results) if overwrite else {}
            found = _read(file, remedy) if file.exists() and not overwrite else None
        except OSError as error:
            if isinstance(error, OutputError):
                raise
            is_file = isinstance(error, FileExistsError | NotADirectoryError)
            reason = "a file is in the way" if is_file else error.strerror or str(error)
            raise OutputError(
                f"results cannot be written to {path}: {reason}. Choose a folder that you may write with --out"
            ) from error
        if found is not None and provenance is None:
            raise OutputError(f"{file} exists already. {remedy}")
        if found is not None and (changed := changes(found, self.provenance)):
            raise OutputError(
                f"{path} holds results of another configuration: {', '.join(changed)}. They are left as they are. "
                f"{remedy}"
            )
        self._unwritten = config_file if is_owner and provenance is not None and found != self.provenance else None
        """Name of the configuration file while it is still to be written."""
        if not (overwrite and file.exists()):
            with self._explained(config_file):
                self._replace_earlier()

    def write(self, name: str, content: str | bytes) -> Path:
        """Replace a file of the folder as a whole and return its path; after an error it is as it was.

        Raises:
            OutputError: the disk is full or gone.
        """
        with self._explained(name), atomic_path(self.path / name) as temporary:
            temporary.write_bytes(content.encode() if isinstance(content, str) else content)
            self._replace_earlier()
        return self.path / name

    def append(self, name: str, row: dict[str, Any]) -> None:
        """Append a JSON object as one line; after an error the file is as it was.

        A last line that was cut off, by a loss of power say, is removed before.

        Raises:
            OutputError: the disk is full or gone.
        """
        line = (json.dumps(row) + "\n").encode()
        with self._explained(name):
            self._replace_earlier()
            if (self.path / name).exists():
                _cut_unfinished_line(self.path / name)
        with self._explained(name), (self.path / name).open("ab", buffering=0) as stream:
            end = stream.tell()
            if stream.write(line) < len(line):
                stream.truncate(end)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    @contextmanager
    def _explained(self, name: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            # An `OutputError` of `atomic_path` has the operating system's error as its cause.
            cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
            raise OutputError(
                f"{name} could not be written to {self.path}: {cause.strerror or cause}. What was finished before is "
                "kept: make room and run the same command again to resume"
            ) from error

    def _replace_earlier(self) -> None:
        """Delete what an earlier run left, and then state the new provenance: results never stand beside another's."""
        for old, identity in self._replaced.items():
            if old.exists() and _identity(old) == identity:
                old.unlink()
        self._replaced = {}
        if self._unwritten is not None:
            atomic_write_text(self.path / self._unwritten, json.dumps(self.provenance, indent=2) + "\n")
            self._unwritten = None

    def _refuse_other_files(self) -> None:
        """Raise `OutputError` if the folder, which has no configuration file, is not empty."""
        if unexpected_files := sorted(file.name for file in self.path.iterdir() if file.name != LOCK_FILE):
            raise OutputError(
                f"{self.path} must be empty or hold earlier results of the same command, it holds "
                f"{', '.join(unexpected_files[:5])}. Choose another folder with --out"
            )


def _read(file: Path, remedy: str) -> dict[str, Any]:
    try:
        found = load_json(file.read_bytes())
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise OutputError(
            f"{file} does not state a configuration of simpick, so nothing can be added to the results beside it. "
            f"{remedy}"
        )
    return found


def _identities(path: Path, patterns: Sequence[str]) -> dict[Path, tuple[int, int]]:
    return {file: _identity(file) for pattern in patterns for file in path.glob(pattern)}


def _identity(file: Path) -> tuple[int, int]:
    """Return what changes when a file is written again."""
    stat = file.stat()
    return stat.st_ino, stat.st_mtime_ns


def _cut_unfinished_line(file: Path) -> None:
    """Remove what stands after a file's last complete line."""
    with file.open("rb+") as stream:
        size = start = stream.seek(0, os.SEEK_END)
        while start:
            end, start = start, max(start - 4096, 0)
            stream.seek(start)
            if (found := stream.read(end - start).rfind(b"\n")) >= 0:
                start += found + 1
                break
        if start < size:
            stream.truncate(start)
