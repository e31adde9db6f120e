"""The cache folder's place, its keys, and writes in one step."""

from pathlib import Path

import pytest

from simpick.caching import atomic_path, atomic_write_text, cache_dir, cache_key
from simpick.errors import OutputError


def test_cache_dir_follows_the_environment(monkeypatch):
    monkeypatch.setenv("SIMPICK_CACHE", "/somewhere/cache")
    assert cache_dir() == Path("/somewhere/cache")
    monkeypatch.delenv("SIMPICK_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/xdg")
    assert cache_dir() == Path("/xdg/simpick")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_dir() == Path.home() / ".cache" / "simpick"


def test_keys_differ_by_version_content_and_boundaries():
    keys = {cache_key(1, "ab", "c"), cache_key(1, "a", "bc"), cache_key(2, "ab", "c"), cache_key(1, "ab", b"c")}
    assert len(keys) == 4
    assert cache_key(1, "ab", 2) == cache_key(1, "ab", 2)


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path):
    target = tmp_path / "deep" / "file.txt"
    atomic_write_text(target, "old")
    with pytest.raises(RuntimeError), atomic_path(target) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert target.read_text() == "old"
    assert list(target.parent.iterdir()) == [target]


def test_unwritable_folder_is_an_error_with_a_remedy(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"cannot write to .*: .*SIMPICK_CACHE"):
        atomic_write_text(tmp_path / "file" / "x", "")
