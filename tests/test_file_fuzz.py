"""Whatever files of arrays, settings, results, logs, cameras, scenes and weights hold: checked values, or an error."""

from __future__ import annotations

import json
import math
import shutil
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from safetensors.torch import save_file

from simpick.caching import read_arrays, write_arrays
from simpick.config import from_json
from simpick.errors import (
    ArrayFileError,
    CameraFileError,
    CheckpointError,
    ConfigError,
    DatasetError,
    OutputError,
    SceneError,
)
from simpick.estimators.detector.checkpoints import (
    FORMAT,
    VERSION,
    load_detector_checkpoint,
    save_detector_checkpoint,
)
from simpick.estimators.detector.network import InstanceNetwork
from simpick.estimators.detector.scores import MaskScore
from simpick.estimators.raypose.checkpoints import load_checkpoint, save_checkpoint
from simpick.experiments.result_store import read_results
from simpick.photos.camera_files import read_calibration
from simpick.run_folder import RunFolder
from simpick.scene import Scene, SceneConfig, build_scene
from simpick.scene.archive import read_archive
from simpick.training.config import TrainConfig, read_train_config
from simpick.training.curves import read_log
from simpick.training.detector.config import DetectorTrainConfig, read_detector_train_config
from simpick.training.moving_average import moving_average
from simpick.training.run_folder import TrainingFolder
from simpick.training.state import TrainingState
from tests.damage import FUZZ, WILD, damaged_bytes, damaged_value, refusing, restored
from tests.estimators.raypose.networks import awake
from tests.experiments.test_result_store import make_result

ARRAYS = {"image": np.arange(60, dtype=np.uint8).reshape(3, 4, 5), "names": np.array(["a", "bc"])}
K = [[800.0, 0, 320], [0, 800, 240], [0, 0, 1]]
CAMERAS = [
    {"camera_matrix": K, "dist_coeffs": [[0.1, 0, 0, 0, 0]], "image_size": [640, 480]},
    {
        "distortion_model": "plumb_bob",
        "K": [x for row in K for x in row],
        "D": [0.1, 0, 0, 0],
        "width": 640,
        "height": 480,
    },
    {"fx": 800, "fy": 800, "cx": 320, "cy": 240, "width": 640, "height": 480, "depth_scale": 0.1},
    {"color": {"ppx": 320, "ppy": 240, "fx": 800, "fy": 800, "model": "Brown Conrady", "coeffs": [0.1, 0, 0, 0, 0]}},
]
GROWING = "".join(f"{y}: &{y} [*{x}, *{x}, *{x}]\n" for x, y in pairwise("abcdefghi"))
YAML = """%YAML:1.0
camera_matrix: !!opencv-matrix {rows: 3, cols: 3, dt: d, data: [800., 0., 320., 0., 800., 240., 0., 0., 1.]}
image_width: 640
image_height: 480
distortion_coefficients: &a [0.1, 0, 0, 0, 0]
"""
ROWS = [
    {"split": "train", "step": 3, "queries": 40, "seconds": 1.5, "loss": 0.5},
    {"split": "validation", "step": 4, "queries": 40, "seconds": 2.5, "rotation_deg": 30.0},
]


@FUZZ
@given(data=st.data())
def test_arrays(tmp_path: Path, data: st.DataObject) -> None:
    file = tmp_path / "a.npz"
    write_arrays(file, ARRAYS)
    file.write_bytes(data.draw(damaged_bytes(file.read_bytes())))
    with refusing(ArrayFileError, file.name):
        for name, array in read_arrays(file).items():
            # A damaged name is the reader's to notice; damaged content never comes through.
            if name in ARRAYS:
                np.testing.assert_array_equal(array, ARRAYS[name])


@FUZZ
@given(value=damaged_value(SceneConfig(parts=("hex_nut",), count=2).to_json()))
def test_configurations(value: Any) -> None:
    with refusing(ConfigError, ""):
        config = from_json(SceneConfig, json.loads(json.dumps(value)), complete=True)
        assert 1 <= config.count < 2**31


@FUZZ
@given(data=st.data(), kind=st.sampled_from([TrainConfig, DetectorTrainConfig]), is_whole_run=st.booleans())
def test_settings_of_training(tmp_path: Path, data: st.DataObject, kind: Any, is_whole_run: bool) -> None:
    file, whole = tmp_path / "config.json", json.loads(json.dumps(kind().to_json()))
    value = data.draw(damaged_value({"network": {}, "training": whole} if is_whole_run else whole))
    file.write_text(json.dumps(value))
    with refusing(ConfigError, file.name):
        config = (read_train_config if kind is TrainConfig else read_detector_train_config)(file)
        assert type(config) is kind and 0 < config.learning_rate < math.inf


@FUZZ
@given(value=damaged_value(make_result().to_json()), torn=st.booleans())
def test_results(tmp_path: Path, value: Any, torn: bool) -> None:
    file = tmp_path / "results.jsonl"
    file.write_text(json.dumps(make_result().to_json()) + "\n" + json.dumps(value) + "\n" * torn)
    with refusing(OutputError, file.name):
        results = read_results(file)
        assert results[0] == make_result()
        assert all(abs(result.seed) < 2**64 for result in results)


@FUZZ
@given(value=WILD)
def test_provenance(tmp_path: Path, value: Any) -> None:
    shutil.rmtree(tmp_path)
    tmp_path.mkdir()
    (tmp_path / "config.json").write_text(json.dumps(value))
    with refusing(OutputError, "config.json", str(tmp_path)):
        RunFolder(tmp_path, {"seed": 0})


@FUZZ
@given(value=damaged_value(ROWS))
def test_training_logs(tmp_path: Path, value: Any) -> None:
    file = tmp_path / "log.jsonl"
    file.write_text("".join(json.dumps(row) + "\n" for row in (value if isinstance(value, list) else [value])))
    with refusing(DatasetError, file.name):
        assert all(type(row["step"]) is int for row in read_log(file))


@FUZZ
@given(value=st.sampled_from(CAMERAS).flatmap(damaged_value))
def test_cameras(tmp_path: Path, value: Any) -> None:
    check_camera(tmp_path / "camera.json", json.dumps(value).encode())


@FUZZ
@given(content=damaged_bytes(YAML.encode()))
def test_yaml_cameras(tmp_path: Path, content: bytes) -> None:
    check_camera(tmp_path / "camera.yaml", content)


@pytest.mark.parametrize(
    "text",
    [
        "K: &a [*a, *a]\n",
        "a: &a [0, 0, 0, 0]\n" + GROWING + "K: *i\n",
        "K: " + "[" * 5000,
        "K: [1e400, 0, 0, 0, 1, 0, 0, 0, 1]\n",
    ],
)
def test_yaml_that_grows_without_end(tmp_path: Path, text: str) -> None:
    (tmp_path / "camera.yaml").write_text(text)
    with pytest.raises(CameraFileError, match=r"camera\.yaml"):
        read_calibration(tmp_path / "camera.yaml")


def check_camera(file: Path, content: bytes) -> None:
    file.write_bytes(content)
    with refusing(CameraFileError, file.name):
        camera = read_calibration(file)
        assert all(math.isfinite(x) for x in (camera.fx, camera.fy, camera.cx, camera.cy)) and camera.fx > 0


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = build_scene(SceneConfig(parts=("hex_nut",), count=1), seed=0)
    return scene.save(tmp_path_factory.mktemp("scenes") / "scene.npz")


@FUZZ
@given(data=st.data())
def test_scene_files(scene_file: Path, tmp_path: Path, data: st.DataObject) -> None:
    file = tmp_path / "scene.npz"
    file.write_bytes(data.draw(damaged_bytes(scene_file.read_bytes())))
    with refusing(SceneError, file.name):
        found, whole = read_archive(file), read_archive(scene_file)
        np.testing.assert_array_equal(found.state, whole.state)
        assert found.config == whole.config


@FUZZ
@given(data=st.data())
def test_headers_of_scene_files(scene_file: Path, tmp_path: Path, data: st.DataObject) -> None:
    file, arrays = tmp_path / "scene.npz", read_arrays(scene_file)
    header = data.draw(damaged_value(json.loads(str(arrays["header"]))))
    write_arrays(file, arrays | {"header": np.array(json.dumps(header))})
    with refusing(SceneError, file.name):
        archive = read_archive(file)
        assert 0 <= archive.seed < 2**64 and len(archive.part_hashes) > max(archive.removed, default=-1)


@pytest.fixture(scope="module")
def weights_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("weights") / "model.safetensors"
    save_checkpoint(file, awake(), {"hours": 1.5})
    return file


@FUZZ
@given(data=st.data())
def test_checkpoints(weights_file: Path, tmp_path: Path, data: st.DataObject) -> None:
    file, content = tmp_path / "model.safetensors", weights_file.read_bytes()
    # The header, where names, types and shapes stand; of the weights themselves there is no checksum.
    end = 8 + int.from_bytes(content[:8], "little")
    file.write_bytes(data.draw(damaged_bytes(content[:end])) + content[end:])
    with refusing(CheckpointError, file.name):
        load_checkpoint(file)


@pytest.fixture(scope="module")
def detector_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("detector") / "detector.safetensors"
    save_detector_checkpoint(file, InstanceNetwork(), MaskScore(), {"hours": 1.5})
    return file


@FUZZ
@given(data=st.data())
def test_detector_checkpoints(detector_file: Path, data: st.DataObject) -> None:
    with restored(detector_file) as content:
        end = 8 + int.from_bytes(content[:8], "little")
        detector_file.write_bytes(data.draw(damaged_bytes(content[:end])) + content[end:])
        with refusing(CheckpointError, detector_file.name):
            score = load_detector_checkpoint(detector_file).score
            assert np.isfinite([score.intercept, *score.weights]).all() and len(score.weights) == 4


@FUZZ
@given(score=damaged_value([-6.0, 4.0, -4.0, 4.0, 0.3]), card=WILD)
def test_cards_of_detector_checkpoints(tmp_path: Path, score: Any, card: Any) -> None:
    file = tmp_path / "detector.safetensors"
    header = {"format": FORMAT, "version": VERSION, "score": json.dumps(score), "card": json.dumps(card)}
    save_file({"foreign": torch.zeros(1)}, file, header)
    with pytest.raises(CheckpointError, match=file.name) as refused:
        load_detector_checkpoint(file)
    # They are checked last: what complains of them has taken the card.
    if "the weights in" in str(refused.value):
        assert isinstance(card, dict) and len(score) == 5 and np.isfinite(np.array(score, float)).all()


@pytest.fixture(scope="module")
def training(tmp_path_factory: pytest.TempPathFactory) -> TrainingFolder:
    run = TrainingFolder(tmp_path_factory.mktemp("training"), {})
    run.save_state(small_state().save())
    return run


@FUZZ
@given(data=st.data())
def test_states_of_training(training: TrainingFolder, data: st.DataObject) -> None:
    with restored(training.path / "state.pt") as whole:
        (training.path / "state.pt").write_bytes(data.draw(damaged_bytes(whole)))
        check_resume(training)


@FUZZ
@given(data=st.data())
def test_edited_states_of_training(training: TrainingFolder, data: st.DataObject) -> None:
    saved = small_state().save()
    key = data.draw(st.sampled_from(sorted(saved)))
    with restored(training.path / "state.pt"):
        training.save_state(saved | {key: data.draw(WILD)} if data.draw(st.booleans()) else {key: saved[key]})
        check_resume(training)


def small_state() -> TrainingState[torch.nn.Linear]:
    model = torch.nn.Linear(2, 2)
    state = TrainingState(model, moving_average(model, 0.9), torch.optim.AdamW(model.parameters()), 3, 1.5)
    state.descend(model(torch.ones(1, 2)).sum(), 1.0)
    return state


def check_resume(run: TrainingFolder) -> None:
    state = small_state()
    with refusing(ConfigError, str(run.path)):
        saved = run.load_state()
        assert saved is not None
        run.restore(state, saved)
        assert type(state.step) is int and state.step >= 0 and 0 <= state.seconds < math.inf


@FUZZ
@given(data=st.data())
def test_damaged_scene_files_load_the_same_scene_or_none(scene_file: Path, tmp_path: Path, data: st.DataObject) -> None:
    file, content = tmp_path / "scene.npz", scene_file.read_bytes()
    k = data.draw(st.integers(0, len(content) - 1))
    file.write_bytes(content[:k] + bytes([content[k] ^ data.draw(st.integers(1, 255))]) + content[k + 1 :])
    with refusing(SceneError, file.name):
        read_archive(file)
        assert Scene.load(file).seed == 0
