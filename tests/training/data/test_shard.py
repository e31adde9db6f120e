"""Shards on disk: what is written comes back, and what is no shard is refused by name."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simpick.caching import read_arrays
from simpick.errors import DatasetError
from simpick.geometry import ContinuousSymmetry, SymmetryGroup
from simpick.training.data.shard import Shard

pytestmark = pytest.mark.render


def assert_equal(a: Shard, b: Shard) -> None:
    for name in ("rgb", "labels", "masks", "focal_px", "Ts_crop_part", "visible_fractions", "source_side_px", "views"):
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    assert (a.part, a.diameter_m) == (b.part, b.diameter_m)
    assert np.array_equal(a.symmetries.discrete, b.symmetries.discrete)
    assert a.symmetries.continuous == b.symmetries.continuous
    assert a.templates.part == b.templates.part and a.templates.camera == b.templates.camera
    for name in ("rgb", "depth_m", "Ts_camera_part"):
        assert np.array_equal(getattr(a.templates, name), getattr(b.templates, name)), name


def test_a_shard_comes_back_bit_for_bit(tiny_shard: Shard, tmp_path: Path) -> None:
    tiny_shard.save(tmp_path / "a.shard")
    assert_equal(Shard.load(tmp_path / "a.shard"), tiny_shard)
    assert [p.name for p in tmp_path.iterdir()] == ["a.shard"]


def test_symmetries_come_back(tiny_shard: Shard, tmp_path: Path) -> None:
    group = SymmetryGroup(SymmetryGroup.cyclic(3).discrete, (ContinuousSymmetry((0.0, 0.6, 0.8), (0.01, -0.02, 0.03)),))
    replace(tiny_shard, symmetries=group).save(tmp_path / "a.shard")
    assert_equal(Shard.load(tmp_path / "a.shard"), replace(tiny_shard, symmetries=group))


def test_a_shard_of_plain_bytes_as_simpick_0_1_wrote_it_is_read(tiny_shard: Shard, tmp_path: Path) -> None:
    tiny_shard.save(tmp_path / "a.shard")
    arrays = read_arrays(tmp_path / "a.shard")
    with zipfile.ZipFile(tmp_path / "old.shard", "w") as file:
        for name, array in arrays.items():
            file.writestr(name, array.tobytes())
    assert_equal(Shard.load(tmp_path / "old.shard"), tiny_shard)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"there is no shard .*a\.shard"):
        Shard.load(tmp_path / "a.shard")


@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_a_truncated_file_is_refused(tiny_shard: Shard, tmp_path: Path, share: float) -> None:
    path = tmp_path / "a.shard"
    tiny_shard.save(path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(DatasetError, match=r"a\.shard must be a whole shard, is damaged or foreign .*; delete it"):
        Shard.load(path)


def test_a_flipped_bit_is_found(tiny_shard: Shard, tmp_path: Path) -> None:
    path = tmp_path / "a.shard"
    tiny_shard.save(path)
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(DatasetError, match="damaged"):
        Shard.load(path)


def test_a_foreign_file_and_another_version_are_distinguished(tiny_shard: Shard, tmp_path: Path) -> None:
    path = tmp_path / "a.shard"
    for header, text in [
        ({"format": "other"}, "must be a shard of training data, has another format"),
        ({"format": "simpick-shard", "version": 99}, r"of version 2, got 99: another version of simpick wrote it"),
    ]:
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("header.json", json.dumps(header))
        with pytest.raises(DatasetError, match=text):
            Shard.load(path)
    path.write_text("no archive")
    with pytest.raises(DatasetError, match="damaged or foreign"):
        Shard.load(path)
