"""No dead options: every field of a configuration is read by some code beside the class that declares it."""

import ast
from dataclasses import fields
from functools import cache
from pathlib import Path

import pytest

import simpick
import simpick.estimators
from simpick.estimators.detector import LearnedDetectorConfig
from simpick.estimators.raypose.estimator import RayPoseEstimatorConfig
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.loss_weights import LossWeights
from simpick.estimators.refiner.config import AlignmentLevel, RefinerConfig
from simpick.rendering.camera_effects import CameraEffects
from simpick.training.config import TrainConfig
from simpick.training.data.augmentation import AugmentationConfig
from simpick.training.data.data_config import DataConfig
from simpick.training.detector.bin_data import BinDataConfig
from simpick.training.detector.config import CropConfig, DetectorTrainConfig
from simpick.training.detector.resources import DetectorResources
from simpick.training.resources import Resources

CONFIGS = (
    AlignmentLevel,
    AugmentationConfig,
    BinDataConfig,
    CameraEffects,
    CropConfig,
    DataConfig,
    DetectorResources,
    DetectorTrainConfig,
    LearnedDetectorConfig,
    Resources,
    RayPoseConfig,
    RayPoseEstimatorConfig,
    RefinerConfig,
    TrainConfig,
)


@cache
def attributes_read() -> set[str]:
    """Return the names of all attributes that are read anywhere but in a class's own check of its values."""
    names = set()
    folders = [Path(simpick.__file__).parent, Path(simpick.estimators.__file__).resolve().parent]
    for file in (file for folder in folders for file in folder.rglob("*.py")):
        tree = ast.parse(file.read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and node.name == "_check_rules":
                node.body = [ast.Pass()]
        names |= {
            n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Load)
        }  # fmt: skip
    return names


@pytest.mark.parametrize("config", CONFIGS, ids=lambda c: c.__name__)
def test_every_field_is_read(config: type) -> None:
    dead = {field.name for field in fields(config)} - attributes_read()
    assert not dead, f"nothing reads {', '.join(sorted(dead))} of {config.__name__}"


def test_every_weight_has_a_loss_of_its_name() -> None:
    from simpick.estimators.raypose.network import losses

    named = {field.name for field in fields(LossWeights)}
    terms = {n.value for n in ast.walk(ast.parse(Path(losses.__file__).read_text())) if isinstance(n, ast.Constant)}
    for file in ("training_step.py", "data/flow_targets.py"):
        step = Path(simpick.__file__).parent / "training" / file
        terms |= {n.value for n in ast.walk(ast.parse(step.read_text())) if isinstance(n, ast.Constant)}
    assert named <= terms
