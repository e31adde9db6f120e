"""Whatever an onboarding file holds: the part that was onboarded, or an error that names the file."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simpick.assets import get_part
from simpick.caching import read_arrays, write_arrays
from simpick.errors import ArrayFileError, ConfigError
from simpick.photos import load_onboarding, save_onboarding
from tests.damage import FUZZ, damaged_bytes, damaged_value, refusing, restored


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("onboarding") / "nut.simpick"
    save_onboarding(path, get_part("hex_nut"), [])
    return path


def check(file: Path, part_hash: str) -> None:
    with refusing((ArrayFileError, ConfigError), file.name):
        part = load_onboarding(file)
        assert part.content_hash == part_hash and isinstance(part.name, str) and 0 < part.metres_per_cad_unit < math.inf
        assert abs(np.linalg.det(part.T_cad_part) - 1) < 1e-6


@FUZZ
@given(data=st.data())
def test_damaged_files(file: Path, data: st.DataObject) -> None:
    part_hash = load_onboarding(file).content_hash
    with restored(file) as whole:
        file.write_bytes(data.draw(damaged_bytes(whole)))
        check(file, part_hash)


@FUZZ
@given(data=st.data(), name=st.sampled_from(["part", "meta"]))
def test_edited_facts(file: Path, data: st.DataObject, name: str) -> None:
    part_hash = load_onboarding(file).content_hash
    with restored(file):
        arrays = read_arrays(file)
        value = data.draw(damaged_value(json.loads(arrays[name].tobytes())))
        # The hash in the file is the reader's check; with another one, another part is right.
        part_hash = value.get("hash", part_hash) if name == "meta" and isinstance(value, dict) else part_hash
        write_arrays(file, arrays | {name: np.frombuffer(json.dumps(value).encode(), np.uint8)})
        check(file, part_hash)


WRONG = [np.zeros(0), np.zeros((2, 3, 4)), np.array(["x"]), np.array(1j), np.full((8, 3), np.nan), np.arange(9) - 3]


@FUZZ
@given(data=st.data(), wrong=st.sampled_from(WRONG))
def test_arrays_of_other_shapes_and_kinds(file: Path, data: st.DataObject, wrong: np.ndarray) -> None:
    part_hash = load_onboarding(file).content_hash
    with restored(file):
        arrays: dict[str, Any] = read_arrays(file)
        arrays[data.draw(st.sampled_from(sorted(arrays)))] = wrong
        write_arrays(file, arrays)
        check(file, part_hash)
