"""Whatever the entry of an added part holds: a sound part, or a `MeshError` that says how to mend it."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from simpick.assets import add_user_part, user_parts
from simpick.errors import MeshError
from tests.damage import FUZZ, damaged_bytes, damaged_value, refusing, restored


@pytest.fixture(scope="module")
def entry(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The settings file of an added brick, in a cache of its own."""
    folder = tmp_path_factory.mktemp("parts")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SIMPICK_CACHE", str(folder))
        trimesh.creation.box([60, 20, 10]).export(folder / "brick.stl")
        add_user_part(folder / "brick.stl", name="brick")
        yield user_parts.user_parts_dir() / "brick" / "part.json"


def check(entry: Path, content: bytes) -> None:
    with restored(entry), refusing(MeshError, "brick"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        entry.write_bytes(content)
        part = user_parts.load_user_part("brick")
        assert part.mesh.is_volume and np.isfinite(part.mass_kg) and part.mass_kg > 0


@FUZZ
@given(data=st.data())
def test_edited_entries(entry: Path, data: st.DataObject) -> None:
    check(entry, json.dumps(data.draw(damaged_value(json.loads(entry.read_text())))).encode())


@FUZZ
@given(data=st.data())
def test_damaged_entries(entry: Path, data: st.DataObject) -> None:
    check(entry, data.draw(damaged_bytes(entry.read_bytes())))
