"""A folder belongs to one provenance, and files in it are written whole or not at all."""

import errno
import json
import os
from pathlib import Path

import pytest

from simpick import run_folder
from simpick.errors import OutputError
from simpick.run_folder import RunFolder

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
    assert list((tmp_path / "new").iterdir()) == []
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
    RunFolder(tmp_path, {}, results=("*.rrd",), overwrite=True)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["config.json", "notes.txt"]
    (tmp_path / "config.json").unlink()
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
        Path, "open", lambda path, *arguments, **settings: Full(real_open(path, *arguments, **settings))
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

    def full(target: Path, content: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(run_folder, "atomic_write_bytes", full)
    with pytest.raises(OutputError, match=r"state could not be written to .*make room and run the same command again"):
        folder.write("state", "second")
    assert (tmp_path / "state").read_text() == "first"
