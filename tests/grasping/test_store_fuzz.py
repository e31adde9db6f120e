"""Whatever a file of stored grasps holds: grasps that fit the part, or none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simpick.assets import get_part
from simpick.bop.conventions import check_rigid
from simpick.caching import read_arrays, write_arrays
from simpick.grasping.store import load_file, save_grasps, shipped_path
from simpick.records import Grasp
from tests.damage import FUZZ, damaged_bytes, restored
from tests.runtime_types import unchecked

NUT = get_part("hex_nut")
WRONG = [
    *(np.zeros(0), np.zeros((2, 3, 4)), np.array(["x"]), np.array(1j), np.full((8, 3), np.nan), np.arange(9) - 3),
    *(np.zeros((3, 4), np.float32), np.full(3, np.inf, np.float32), np.float32(1.0)),
]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("grasps") / "nut.npz"
    grasps = load_file(shipped_path("hex_nut", "jaw"), NUT, "jaw")
    assert grasps is not None
    save_grasps(path, NUT, "jaw", grasps[:3])
    return path


def read(file: Path) -> list[Grasp] | None:
    with unchecked():
        grasps = load_file(file, NUT, "jaw")
    for grasp in grasps or ():
        check_rigid(grasp.T_part_tcp, "grasp")
        assert 0 <= grasp.width_m < 1 and np.isfinite(grasp.quality)
    return grasps


def test_whole_files_are_read(file: Path) -> None:
    grasps = read(file)
    assert grasps is not None and len(grasps) == 3


@FUZZ
@given(data=st.data())
def test_damaged_files(file: Path, data: st.DataObject) -> None:
    with restored(file) as whole:
        file.write_bytes(data.draw(damaged_bytes(whole)))
        grasps = read(file)
        assert grasps is None or len(grasps) == 3


@pytest.mark.parametrize("name", ["recipe", "signature", "position_m", "quaternion", "width_m", "quality"])
@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: f"{wrong.shape} {wrong.dtype}")
def test_arrays_of_other_shapes_and_kinds(file: Path, name: str, wrong: np.ndarray) -> None:
    with restored(file):
        write_arrays(file, read_arrays(file) | {name: np.asarray(wrong)})
        assert read(file) is None
