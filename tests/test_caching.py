"""The cache folder's place, its keys, files of arrays, and writes in one step."""

import errno
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from simpick.caching import (
    atomic_path,
    atomic_write_text,
    cache_dir,
    cache_key,
    cache_name,
    cached_arrays,
    read_arrays,
    write_arrays,
)
from simpick.errors import ArrayFileError, OutputError

ARRAYS = {"image": np.arange(60, dtype=np.uint8).reshape(3, 4, 5), "names": np.array(["a", "bc"])}


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


def test_a_full_disk_is_an_error_with_a_remedy(tmp_path):
    target = tmp_path / "file.txt"
    atomic_write_text(target, "old")
    with (
        pytest.raises(
            OutputError,
            match=r"cannot write to .*file\.txt: No space left on device\. What was there before is kept\. Make room",
        ),
        atomic_path(target),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert target.read_text() == "old" and list(tmp_path.iterdir()) == [target]


def test_arrays_come_back_and_equal_arrays_give_equal_bytes(tmp_path):
    for name in ("a.npz", "b.npz"):
        write_arrays(tmp_path / name, ARRAYS)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    for read in (read_arrays(tmp_path / "a.npz"), np.load(tmp_path / "a.npz")):
        assert set(read) == set(ARRAYS)
        for name, array in ARRAYS.items():
            np.testing.assert_array_equal(read[name], array)


def test_plain_members_come_as_bytes(tmp_path):
    with zipfile.ZipFile(tmp_path / "old.zip", "w") as file:
        file.writestr("depth", np.array([1, 2], "<u2").tobytes())
    assert read_arrays(tmp_path / "old.zip")["depth"].view("<u2").tolist() == [1, 2]


@pytest.mark.parametrize("damage", ["empty", "truncated", "flipped", "text", "pickle"])
def test_a_damaged_file_is_an_error_and_is_made_again_in_the_cache(tmp_path, damage):
    path = tmp_path / "a.npz"
    write_arrays(path, ARRAYS)
    content = bytearray(path.read_bytes())
    content[60] ^= 1
    if damage == "pickle":
        np.savez(path, image=np.array([{}], object))
    else:
        path.write_bytes({"empty": b"", "truncated": content[:90], "flipped": content, "text": b"no zip"}[damage])
    with pytest.raises(ArrayFileError, match=r"a\.npz must be a whole file of arrays, is damaged or foreign \(.+\)"):
        read_arrays(path)
    assert cached_arrays(path, ARRAYS, lambda: ARRAYS).keys() == ARRAYS.keys()
    assert read_arrays(path).keys() == ARRAYS.keys()


def test_cached_arrays_are_made_once_and_again_where_one_is_missing(tmp_path):
    path, made = tmp_path / "deep" / "a.npz", []

    def make() -> dict[str, np.ndarray]:
        made.append(1)
        return ARRAYS

    for _ in range(2):
        cached_arrays(path, ARRAYS, make)
    assert len(made) == 1
    write_arrays(path, {"image": ARRAYS["image"]})
    cached_arrays(path, ARRAYS, make)
    assert len(made) == 2


def test_a_damaged_cache_is_made_again_once_with_a_note(tmp_path, caplog):
    path, made = tmp_path / "cached.npz", []

    def make():
        made.append(path)
        return ARRAYS

    cached_arrays(path, ARRAYS, make)
    whole = path.read_bytes()
    for k in (0, 4, 8, len(whole) // 2, len(whole) - 60, len(whole) - 4):
        path.write_bytes(whole[:k] + bytes([whole[k] ^ 0xFF]) + whole[k + 1 :])
        made.clear()
        caplog.clear()
        for _ in range(2):
            np.testing.assert_array_equal(cached_arrays(path, ARRAYS, make)["image"], ARRAYS["image"])
        assert len(made) == len(caplog.records) <= 1
        assert all("cached.npz" in text and "its content is made again" in text for text in caplog.messages)
    path.write_bytes(whole[:-1])
    cached_arrays(path, ARRAYS, make)
    assert path.read_bytes() == whole and "made again" in caplog.text


@pytest.mark.parametrize(
    ("code", "remedy"),
    [
        (errno.EROFS, r"Read-only file system\. What was there before is kept\. Choose a folder that you may write to"),
        (errno.EDQUOT, r"What was there before is kept\. Make room, or set SIMPICK_CACHE"),
    ],
)
def test_what_a_disk_refuses_has_its_remedy(code, remedy, tmp_path):
    with pytest.raises(OutputError, match=remedy), atomic_path(tmp_path / "file"):
        raise OSError(code, os.strerror(code))


def test_long_names(tmp_path):
    atomic_write_text(tmp_path / ("x" * 251 + ".txt"), "as long as a name may be")
    with pytest.raises(
        OutputError, match=r"File name too long\. What was there before is kept\. Choose a shorter name"
    ):
        atomic_write_text(tmp_path / ("x" * 300), "")
    write_arrays(tmp_path / cache_name("x" * 300, cache_key(1, "x")), ARRAYS)
    assert len(list(tmp_path.iterdir())) == 2


def test_arrays_of_impossible_sizes_are_refused(tmp_path):
    header = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little")
    header += b"{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000,), }".ljust(117) + b"\n"
    with zipfile.ZipFile(tmp_path / "huge.npz", "w") as file:
        file.writestr("a.npy", header)
    with pytest.raises(ArrayFileError, match=r"huge\.npz must be a whole file of arrays"):
        read_arrays(tmp_path / "huge.npz")
