"""A part's onboarding in one file: the same part and the same poses on a machine without OpenGL."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simpick import load_estimator
from simpick.assets import get_part
from simpick.caching import read_arrays, write_arrays
from simpick.errors import ArrayFileError, ConfigError
from simpick.geometry import Pinhole, so3_exp, transform
from simpick.photos import load_onboarding, save_onboarding
from simpick.rendering import PartRenderer
from tests.runtime_types import unchecked

CAMERA = Pinhole(160, 120, 240.0, 240.0, 80.5, 60.5)
ELSEWHERE = """
import sys, numpy as np, simpick
from simpick.records import Detection
data = np.load(sys.argv[1])
found = [Detection("pipe_tee", np.array([0.0, 0, 1, 1]), data["mask"], 1.0)]
K = np.array([[240.0, 0, 80], [0, 240, 60], [0, 0, 1]])
(answer,) = simpick.estimate(data["rgb"], K, sys.argv[2], mode="retrieval_refined", detections=found)
np.save(sys.argv[3], answer.T_camera_part)
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("onboarding") / "tee.simpick"
    save_onboarding(path, get_part("pipe_tee"), [load_estimator("retrieval")])
    return path


def test_the_part_comes_back_as_it_was(file: Path) -> None:
    part, loaded = get_part("pipe_tee"), load_onboarding(file)
    assert loaded.name == part.name and loaded.mass_kg == pytest.approx(part.mass_kg)
    assert loaded.metres_per_cad_unit == part.metres_per_cad_unit and loaded.material == part.material
    np.testing.assert_array_equal(loaded.T_cad_part, part.T_cad_part)
    np.testing.assert_allclose(loaded.symmetries.transforms(8), part.symmetries.transforms(8), atol=1e-12)


def test_poses_are_the_same_without_opengl(file: Path, tmp_path: Path) -> None:
    pytest.importorskip("embreex", reason="has no wheels for Linux on ARM")
    T = transform(so3_exp(np.array([0.5, 0.7, 0.2])), np.array([0.0, 0.01, 0.25]))
    with PartRenderer(get_part("pipe_tee"), 120, 160) as renderer:
        views = renderer.render(T[None], CAMERA)
    assert views.rgb is not None
    np.savez(tmp_path / "image.npz", rgb=views.rgb[0], mask=views.masks[0])
    arguments = [sys.executable, "-c", ELSEWHERE, str(tmp_path / "image.npz"), str(file)]
    poses = []
    for gl in ("", "off"):
        cache = tmp_path / f"cache{gl}"
        environment = {**os.environ, "SIMPICK_CACHE": str(cache)} | ({"MUJOCO_GL": gl} if gl else {})
        subprocess.run([*arguments, str(tmp_path / f"pose{gl}.npy")], env=environment, check=True)
        poses.append(np.load(tmp_path / f"pose{gl}.npy"))
    # Rays and OpenGL disagree about single pixels at the part's outline.
    np.testing.assert_allclose(poses[0], poses[1], atol=0.01)
    diameter_m = get_part("pipe_tee").diameter_m
    assert np.linalg.norm(poses[1][:3, 3] - T[:3, 3]) < 0.05 * diameter_m


def test_files_that_do_not_fit_are_refused(file: Path, tmp_path: Path) -> None:
    with pytest.raises(ArrayFileError, match=r"no onboarding file .* simpick parts onboard PART"):
        load_onboarding(tmp_path / "no.simpick")
    arrays = read_arrays(file)
    meta = json.loads(arrays["meta"].tobytes())
    meta["versions"]["mujoco"] = "1.2.3"
    other = tmp_path / "other.simpick"
    write_arrays(other, {**arrays, "meta": np.frombuffer(json.dumps(meta).encode(), np.uint8)})
    with pytest.raises(ConfigError, match=r"made with mujoco 1\.2\.3 instead of .*; install the same versions"):
        load_onboarding(other)
    moved = {**arrays, "mesh/vertices": np.asarray(arrays["mesh/vertices"]) * 1.001}
    write_arrays(other, moved)
    with pytest.raises(ArrayFileError, match="not the one that was onboarded"):
        load_onboarding(other)
    with pytest.raises(ConfigError, match=r"must end in \.simpick"):
        save_onboarding(tmp_path / "tee.npz", get_part("pipe_tee"), [])


@pytest.mark.parametrize(
    "name", ["mesh/vertices", "mesh/faces", "collision_0/vertices", "discrete", "axes", "T_cad_part"]
)
def test_arrays_that_are_no_numbers_of_their_shape_are_refused(file: Path, tmp_path: Path, name: str) -> None:
    arrays = read_arrays(file)
    with unchecked():
        for wrong in (np.full(arrays[name].shape, "x"), np.array(["x"]), arrays[name] + 1j, arrays[name][..., None]):
            write_arrays(tmp_path / "tee.simpick", arrays | {name: wrong})
            with pytest.raises(ArrayFileError, match=f"tee.simpick: the part in it is damaged .{name} must be"):
                load_onboarding(tmp_path / "tee.simpick")
