"""A folder belongs to one provenance, and files in it are written whole or not at all."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock

from simpick.errors import OutputError
from simpick.folder_lock import LOCK_FILE
from simpick.run_folder import RunFolder


def names(folder: Path) -> list[str]:
    """The files in a folder, without its lock."""
    return sorted(file.name for file in folder.iterdir() if file.name != LOCK_FILE)


PROVENANCE = {"network": {"width": 8, "views": [1, 2]}, "seed": 0}


def test_what_differs_is_named_with_both_values(tmp_path: Path) -> None:
    RunFolder(tmp_path, PROVENANCE)
    with pytest.raises(
        OutputError,
        match=r"configuration: network\.views \(\[1, 2\] there, none now\), seed \(0 there, 1 now\)\. .*--out$",
    ):
        RunFolder(tmp_path, {"network": {"width": 8}, "seed": 1})
    assert json.loads((tmp_path / "config.json").read_text()) == PROVENANCE


def test_other_processes_compare_and_write_nothing(tmp_path: Path) -> None:
    RunFolder(tmp_path / "new", PROVENANCE, is_owner=False)
    assert names(tmp_path / "new") == []
    RunFolder(tmp_path / "old", PROVENANCE)
    with pytest.raises(OutputError, match="another configuration"):
        RunFolder(tmp_path / "old", PROVENANCE | {"seed": 1}, is_owner=False)


def test_without_provenance_nothing_is_resumed(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, None, config_file="figures.json", overwrite=False)
    folder.write("figures.json", "{}")
    with pytest.raises(OutputError, match=r"figures\.json exists already\. .* or --overwrite to replace them"):
        RunFolder(tmp_path, None, config_file="figures.json", overwrite=False)
    folder = RunFolder(tmp_path, None, config_file="figures.json", overwrite=True)
    assert (tmp_path / "figures.json").read_text() == "{}", "kept until there are new figures"
    folder.write("figures.json", "[]")
    assert (tmp_path / "figures.json").read_text() == "[]"


def test_overwriting_spares_other_files_and_folders_of_others(tmp_path: Path) -> None:
    RunFolder(tmp_path, PROVENANCE).write("a.rrd", "old")
    (tmp_path / "notes.txt").write_text("keep me")
    RunFolder(tmp_path, {}, results=("*.rrd",), overwrite=True).write("results", "new")
    assert names(tmp_path) == ["config.json", "notes.txt", "results"]
    (tmp_path / "config.json").unlink()
    (tmp_path / "results").unlink()
    with pytest.raises(OutputError, match=r"must be empty or hold earlier results .* it holds notes\.txt\. Choose"):
        RunFolder(tmp_path, {}, overwrite=True)


def test_lines_are_appended_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = RunFolder(tmp_path, PROVENANCE)
    folder.append("log.jsonl", {"step": 1})
    real_open = Path.open

    class Full:
        """A file on a disk that is full after three bytes."""

        def __init__(self, stream) -> None:
            self.stream, self.tell, self.truncate = stream, stream.tell, stream.truncate

        def __enter__(self):
            return self

        def __exit__(self, *exception: object) -> None:
            self.stream.close()

        def write(self, line: bytes) -> int:
            return self.stream.write(line[:3])

    monkeypatch.setattr(
        Path,
        "open",
        lambda path, mode, **settings: (
            Full(real_open(path, mode, **settings)) if mode == "ab" else real_open(path, mode, **settings)
        ),
    )
    with pytest.raises(OutputError, match=r"log\.jsonl could not be written to .*: No space left on device\. What was"):
        folder.append("log.jsonl", {"step": 2})
    monkeypatch.undo()
    folder.append("log.jsonl", {"step": 3})
    assert [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()] == [
        {"step": 1},
        {"step": 3},
    ]


def test_a_full_disk_leaves_a_file_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = RunFolder(tmp_path, PROVENANCE)
    folder.write("state", "first")

    def full(path: Path, content: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match=r"state could not be written to .*make room and run the same command again"):
        folder.write("state", "second")
    assert (tmp_path / "state").read_text() == "first"


def test_overwriting_keeps_earlier_results_until_there_are_new_ones(tmp_path: Path) -> None:
    earlier = RunFolder(tmp_path, PROVENANCE)
    earlier.write("a.rrd", "old")
    earlier.write("b.rrd", "old")
    RunFolder(tmp_path, {"seed": 1}, results=("*.rrd",), overwrite=True)
    assert (tmp_path / "a.rrd").read_text() == "old", "a run that ends before its first result deletes nothing"
    assert json.loads((tmp_path / "config.json").read_text()) == PROVENANCE
    folder = RunFolder(tmp_path, {"seed": 1}, results=("*.rrd",), overwrite=True)
    (tmp_path / "b.rrd").unlink()
    (tmp_path / "b.rrd").write_text("a recording of the new run")
    folder.write("results", "new")
    assert names(tmp_path) == ["b.rrd", "config.json", "results"]
    assert json.loads((tmp_path / "config.json").read_text()) == {"seed": 1}


def test_a_full_disk_does_not_delete_earlier_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    RunFolder(tmp_path, PROVENANCE).write("a.rrd", "old")
    folder = RunFolder(tmp_path, {"seed": 1}, results=("*.rrd",), overwrite=True)

    def full(path: Path, content: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(OutputError, match="No space left on device"):
            folder.write("results", "new")
    assert (tmp_path / "a.rrd").read_text() == "old"


@pytest.mark.parametrize("torn", ['{"step": 2', "\x00" * 9000, '{"step": 2, "loss": 0.5}'])
def test_a_line_that_was_cut_off_is_removed_before_the_next(tmp_path: Path, torn: str) -> None:
    RunFolder(tmp_path, PROVENANCE).append("log.jsonl", {"step": 1})
    with (tmp_path / "log.jsonl").open("a") as stream:
        stream.write(torn)
    RunFolder(tmp_path, PROVENANCE).append("log.jsonl", {"step": 3})
    assert (tmp_path / "log.jsonl").read_text() == '{"step": 1}\n{"step": 3}\n'


WRITER = """
import os, sys
from pathlib import Path
from simpick.run_folder import RunFolder
folder = RunFolder(Path(sys.argv[1]), {"seed": 0})
if "fork" in sys.argv and os.fork() == 0:
    sys.exit()
if "fork" in sys.argv:
    os.wait()
print("holds it", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("options", [(), ("fork",)], ids=["alone", "after a forked process ended"])
def test_a_second_process_is_refused_and_told_who_writes(tmp_path: Path, options: tuple[str, ...]) -> None:
    command = [sys.executable, "-c", WRITER, str(tmp_path), *options]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None and writer.stdout.readline().strip() == b"holds it"
        holder = rf"process {writer.pid} on .* since 2.* \(-c .*\)\."
        with pytest.raises(OutputError, match=rf"is being written by {holder} Wait until it has finished, or choose"):
            RunFolder(tmp_path, {"seed": 0}, overwrite=True)
        writer.kill()
    RunFolder(tmp_path, {"seed": 0}).write("results", "after the other was killed")


def test_the_lock_ends_with_its_last_holder(tmp_path: Path) -> None:
    first, second = RunFolder(tmp_path, {"seed": 0}), RunFolder(tmp_path, {"seed": 0})
    assert first is not second
    lock = FileLock(tmp_path.resolve() / LOCK_FILE, is_singleton=True, thread_local=False)
    del first
    assert lock.is_locked
    del second
    assert not lock.is_locked
