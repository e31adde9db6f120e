"""Any triangles, and any bytes, become a sound solid or a `MeshError`: never a traceback."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from simpick.assets.cad_files import load_file
from simpick.assets.mesh_cleaning import cleaned
from simpick.assets.mesh_solids import is_sound, solidified
from simpick.errors import MeshError
from tests.assets import defective_meshes as defects

_SETTINGS = settings(
    max_examples=settings().max_examples * 2 // 5,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.fixture(autouse=True)
def coarse_wraps(monkeypatch):
    monkeypatch.setattr("simpick.assets.voxel_wrap._CELLS", 12)
    monkeypatch.setattr("simpick.assets.voxel_wrap._SAMPLES", 5000)


def check(mesh: trimesh.Trimesh, **options) -> None:
    # Zero-area faces make trimesh divide by zero; what counts is what comes out.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            mesh, _, _ = cleaned(mesh, "a.stl")
            solid, _ = solidified(mesh.apply_scale(1e-3), "a.stl", **options)
        except MeshError:
            return
    assert is_sound(solid) and solid.volume > 0


@_SETTINGS
@given(
    arrays(float, st.tuples(st.integers(4, 9), st.just(3)), elements=st.integers(-3, 3).map(float)),
    st.lists(st.tuples(*[st.integers(0, 3)] * 3), min_size=1, max_size=14),
    st.sampled_from([0.0, 0.5]),
)
def test_any_triangles(vertices, faces, thickness_m):
    check(trimesh.Trimesh(vertices * 10, faces, process=False), thickness_m=thickness_m * 1e-3)


@_SETTINGS
@given(st.lists(st.integers(0, 25), max_size=8), st.lists(st.integers(0, 25), max_size=8), st.integers(0, 2**32 - 1))
def test_any_faces_of_a_bracket_missing_or_flipped_and_corners_moved(missing, turned, seed):
    mesh = defects.bracket()
    rng = np.random.default_rng(seed)
    mesh.vertices = mesh.vertices + rng.normal(scale=rng.choice([0.0, 1e-5, 1.0]), size=mesh.vertices.shape)
    mesh = defects.flipped(mesh, np.array([k for k in turned if k < len(mesh.faces)], int))
    check(defects.without(mesh, [k for k in missing if k < len(mesh.faces)] or np.zeros(0, int)))


@_SETTINGS
@given(st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), max_size=12), st.integers(0, 10_000))
def test_any_bytes_of_a_file(tmp_path, changes, length):
    exported = defects.bracket().export(file_type="stl")
    assert isinstance(exported, bytes)
    content = bytearray(exported)
    for place, value in changes:
        content[place % len(content)] = value
    file = tmp_path / "a.stl"
    file.write_bytes(content[: len(content) - length % len(content)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            mesh = load_file(file).mesh
        except MeshError:
            return
    check(mesh)
