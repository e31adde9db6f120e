"""A part's onboarding in one file: the same part and the same poses on a machine without OpenGL or MuJoCo."""

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
WITHOUT_MUJOCO = """
import sys
sys.modules.update(dict.fromkeys(["mujoco", "mujoco.egl", "OpenGL", "glfw"]))
"""
COMMAND = """
import cv2
from pathlib import Path
from simpick.cli.main import main
folder = Path(sys.argv[3]).parent
cv2.imwrite(str(folder / "photo.png"), data["rgb"])
given = ["--camera", "240", "240", "80", "60", "--part", sys.argv[2], "--mode", "retrieval_refined"]
boxes = ["--boxes", "20", "5", "140", "118"]
assert main(["estimate", str(folder / "photo.png"), *given, *boxes, "--out", str(folder / "out")]) == 0
"""
SEEN = transform(so3_exp(np.array([0.5, 0.7, 0.2])), np.array([0.0, 0.01, 0.25]))


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


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a file of the part's image and mask in the pose `SEEN`."""
    path = tmp_path_factory.mktemp("image") / "image.npz"
    with PartRenderer(get_part("pipe_tee"), 120, 160) as renderer:
        views = renderer.render(SEEN[None], CAMERA)
    assert views.rgb is not None
    np.savez(path, rgb=views.rgb[0], mask=views.masks[0])
    return path


def estimated(code: str, image: Path, file: Path, folder: Path, **environment: str) -> np.ndarray:
    """Return the pose that a new process with an empty cache estimates."""
    arguments = [sys.executable, "-c", code, str(image), str(file), str(folder / "pose.npy")]
    environment = {**os.environ, "SIMPICK_CACHE": str(folder / "cache"), **environment}
    subprocess.run(arguments, env=environment, cwd=Path(__file__).parents[2], check=True)
    return np.load(folder / "pose.npy")


@pytest.fixture(scope="module")
def by_rays(file: Path, image: Path, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    pytest.importorskip("embreex", reason="has no wheels for Linux on ARM")
    return estimated(ELSEWHERE, image, file, tmp_path_factory.mktemp("rays"), MUJOCO_GL="off")


def test_poses_are_the_same_without_opengl(file: Path, image: Path, by_rays: np.ndarray, tmp_path: Path) -> None:
    # Rays and OpenGL disagree about single pixels at the part's outline.
    np.testing.assert_allclose(estimated(ELSEWHERE, image, file, tmp_path), by_rays, atol=0.01)
    diameter_m = get_part("pipe_tee").diameter_m
    assert np.linalg.norm(by_rays[:3, 3] - SEEN[:3, 3]) < 0.05 * diameter_m


def test_neither_function_nor_command_needs_mujoco(
    file: Path, image: Path, by_rays: np.ndarray, tmp_path: Path
) -> None:
    pose = estimated(WITHOUT_MUJOCO + ELSEWHERE + COMMAND, image, file, tmp_path)
    np.testing.assert_array_equal(pose, by_rays)
    (answer,) = json.loads((tmp_path / "out" / "poses.json").read_text())["images"]
    assert [found["part"] for found in answer["estimates"]] == ["pipe_tee"]
    assert (tmp_path / "out" / "poses.rrd").stat().st_size > 1000


def test_what_needs_mujoco_says_so_where_it_is_missing(tmp_path: Path) -> None:
    code = WITHOUT_MUJOCO + (
        "from simpick.assets import get_part\n"
        "from simpick.cli.main import main\n"
        "from simpick.errors import RenderingUnavailableError\n"
        "from simpick.rendering import load_templates\n"
        "assert main(['run', '--parts', 'hex_bolt', '--out', sys.argv[1]]) == 2\n"
        "try:\n    load_templates(get_part('hex_bolt'))\n"
        "except RenderingUnavailableError as error: print(error)\n"
    )
    arguments = [sys.executable, "-c", code, str(tmp_path / "run")]
    environment = {**os.environ, "SIMPICK_CACHE": str(tmp_path / "cache")}
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=True)
    assert "simpick: this command needs MuJoCo, which cannot be imported here" in done.stderr
    assert "pip install mujoco" in done.stderr
    assert done.stdout.splitlines()[-1].startswith("rendering templates of hex_bolt needs MuJoCo, which cannot be")
    assert "pip install mujoco. Or onboard the part for this mode on another machine" in done.stdout


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
