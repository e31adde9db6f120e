"""Training runs of a few steps: exact resume, what is kept, and what stops a run."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest
import torch

from simpick.errors import CheckpointError, ConfigError, OutputError
from simpick.estimators.detector.checkpoints import load_detector_checkpoint
from simpick.training.budget import Budget
from simpick.training.detector import trainer
from simpick.training.detector.config import CropConfig, read_detector_train_config
from simpick.training.detector.resources import DetectorResources
from simpick.training.detector.trainer import train_detector
from tests.training.detector.conftest import TINY_TRAINING

pytestmark = pytest.mark.render
STEPS = 4


@pytest.fixture
def resources(tiny_bins: Path, monkeypatch: pytest.MonkeyPatch) -> DetectorResources:
    monkeypatch.setattr(trainer, "LOG_STEPS", 1)
    return DetectorResources(device="cpu", renderers=0, loaders=0, threads=1, shards=tiny_bins)


def saved(folder: Path) -> dict:
    return torch.load(folder / "state.pt", weights_only=True)


@pytest.mark.parametrize("crops", ["loaders", "device"])
def test_an_interrupted_run_resumes_bit_by_bit(
    resources: DetectorResources, crops: Literal["loaders", "device"], tmp_path: Path
) -> None:
    resources = replace(resources, crops=crops)

    def interrupt(row: dict, progress: float) -> None:
        if row["step"] == 2:
            os.kill(os.getpid(), signal.SIGINT)

    straight, stopped = tmp_path / "straight", tmp_path / "stopped"
    train_detector(TINY_TRAINING, Budget(steps=STEPS), straight, resources=resources)
    with pytest.raises(KeyboardInterrupt):
        train_detector(TINY_TRAINING, Budget(steps=STEPS), stopped, resources=resources, on_row=interrupt)
    assert saved(stopped)["step"] == 2
    weights = train_detector(TINY_TRAINING, Budget(steps=STEPS), stopped, resources=resources)
    ours, theirs = saved(stopped), saved(straight)
    for kind in ("model", "average"):
        for name, tensor in theirs[kind].items():
            torch.testing.assert_close(ours[kind][name], tensor, rtol=0, atol=0)
    card = load_detector_checkpoint(weights).card
    assert card["steps"] == STEPS and "ap50" in card["validation"]
    rows = [json.loads(line) for line in (stopped / "log.jsonl").read_text().splitlines()]
    assert {row["split"] for row in rows} == {"train", "validation"}


def test_a_finished_run_is_left_as_it_is(resources: DetectorResources, tmp_path: Path) -> None:
    train_detector(TINY_TRAINING, Budget(steps=1), tmp_path, resources=resources)
    before = (tmp_path / "log.jsonl").read_text()
    train_detector(TINY_TRAINING, Budget(steps=1), tmp_path, resources=resources)
    assert (tmp_path / "log.jsonl").read_text() == before


def test_the_first_stages_keep_their_weights(resources: DetectorResources, tmp_path: Path) -> None:
    first = train_detector(TINY_TRAINING, Budget(steps=1), tmp_path / "a", resources=resources)
    second = train_detector(TINY_TRAINING, Budget(steps=2), tmp_path / "b", resources=resources, start_from=first)
    before, after = (load_detector_checkpoint(path).network.encoder for path in (first, second))
    torch.testing.assert_close(before.stem.weight, after.stem.weight, rtol=0, atol=0)
    last = "stages.5.0.project.weight"
    assert not torch.equal(before.get_parameter(last), after.get_parameter(last))


def test_a_folder_of_another_run_is_refused(resources: DetectorResources, tmp_path: Path) -> None:
    train_detector(TINY_TRAINING, Budget(steps=1), tmp_path, resources=resources)
    with pytest.raises(OutputError, match=r"another configuration: training\.batch \(2 there, 4 now\)"):
        train_detector(replace(TINY_TRAINING, batch=4), Budget(steps=1), tmp_path, resources=resources)


def test_weights_that_do_not_fit_are_refused(resources: DetectorResources, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="there is no checkpoint"):
        train_detector(
            TINY_TRAINING, Budget(steps=1), tmp_path, resources=resources, start_from=tmp_path / "none.safetensors"
        )


def test_a_configuration_is_read_from_a_run_and_from_a_file_of_settings(tmp_path: Path) -> None:
    file = tmp_path / "config.json"
    file.write_text(json.dumps({"training": TINY_TRAINING.to_json()}))
    assert read_detector_train_config(file) == TINY_TRAINING
    file.write_text(json.dumps({"batch": 3, "crops": {"size_px": 320}}))
    assert read_detector_train_config(file).crops.size_px == 320
    file.write_text(json.dumps({"bach": 3}))
    with pytest.raises(ConfigError, match="bach is unknown, did you mean 'batch'"):
        read_detector_train_config(file)


def test_crops_must_fit_the_network() -> None:
    with pytest.raises(ConfigError, match="size_px must be a multiple of 32, got 250"):
        CropConfig(size_px=250)
