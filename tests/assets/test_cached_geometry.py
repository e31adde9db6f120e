"""What is found out about user CAD is kept on disk, and found out again where a file there is damaged."""

import numpy as np
import pytest
import trimesh

from simpick.assets import import_cad


@pytest.mark.parametrize("damage", [b"", b"not a file of numpy's", b"PK\x03\x04 cut off"])
def test_damaged_pieces_and_symmetries_are_made_again(tmp_path, monkeypatch, damage):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path / "cache"))
    foot = trimesh.creation.box([60, 20, 10]).apply_translation([30, 10, 5])
    leg = trimesh.creation.box([10, 20, 40]).apply_translation([5, 10, 20])
    trimesh.boolean.union([foot, leg]).export(tmp_path / "angle.stl")
    part = import_cad(tmp_path / "angle.stl").part
    kept = sorted((tmp_path / "cache").glob("*/*.npz"))
    assert {path.parent.name for path in kept} == {"convex_pieces", "symmetries"}
    for path in kept:
        path.write_bytes(damage)
    again = import_cad(tmp_path / "angle.stl").part
    assert len(again.collision) == len(part.collision) > 1
    np.testing.assert_array_equal(again.symmetries.discrete, part.symmetries.discrete)
    assert min(path.stat().st_size for path in kept) > 100
