"""`DetectorTrainConfig`: everything that a training run of the detector depends on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from annotated_types import Interval

from simpick.config import (
    Config,
    Fraction,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    from_json,
    read_json,
)
from simpick.errors import ConfigError
from simpick.estimators.detector.encoder_stages import STAGES, STRIDE
from simpick.rendering.camera_effects import CameraEffects
from simpick.training.detector.bin_data import BinDataConfig
from simpick.training.learning_rate import WarmupAndDecay

_BelowOne = Annotated[float, Interval(ge=0, lt=1)]


@dataclass(frozen=True)
class CropConfig(Config):
    """How strongly training crops are changed."""

    size_px: PositiveInt = 256
    """Side of a crop; a multiple of 32."""
    scale: tuple[PositiveFloat, PositiveFloat] = (0.95, 2.0)
    """Smallest and largest magnification. Bins of 640 px are enlarged 1.5 times when they are segmented."""
    instance_share: Fraction = 0.5
    """Share of crops around a random pixel of a random instance; the others lie around a random pixel of any."""
    effects: CameraEffects = field(default_factory=CameraEffects)
    """What the camera does to the image."""

    def _check_rules(self) -> None:
        if self.size_px % STRIDE:
            raise ConfigError(f"size_px must be a multiple of {STRIDE}, got {self.size_px}")
        if self.scale[0] > self.scale[1]:
            raise ConfigError(f"scale must be two values, the smaller first, got {self.scale[0]} and {self.scale[1]}")


@dataclass(frozen=True)
class LossWeights(Config):
    """Weights of the loss's terms."""

    foreground: NonNegativeFloat = 1.0
    affinity: NonNegativeFloat = 4.0


@dataclass(frozen=True)
class DetectorTrainConfig(WarmupAndDecay, Config):
    """How the detector is trained."""

    seed: NonNegativeInt = 0
    """Of weights and of the order of the data; the data itself has its own."""
    bins: PositiveInt = 700
    """Bins of random parts that crops are taken from."""
    curved_bins: NonNegativeInt = 350
    """Bins of random bent parts that crops are taken from besides."""
    min_ready_bins: PositiveInt = 200
    """Training begins with so many bins; the others are made meanwhile."""
    batch: PositiveInt = 8
    """Crops per step."""
    crops_per_view: PositiveInt = 4
    """Crops of each view that a step reads, the last of a batch excepted."""
    learning_rate: PositiveFloat = 1.5e-3
    """Of AdamW, after the warm-up and before the decay."""
    encoder_rate: Fraction = 0.25
    """Factor on the learning rate of the pretrained encoder."""
    frozen_stages: Annotated[int, Interval(ge=0, le=len(STAGES))] = 2
    """First stages of the encoder that keep their weights."""
    warmup_steps: NonNegativeInt = 100
    """Steps in which the learning rate rises linearly."""
    decay_fraction: _BelowOne = 0.5
    """Share of the run, at its end, in which the learning rate decays exponentially to a hundredth."""
    weight_decay: NonNegativeFloat = 0.01
    """Of AdamW."""
    max_grad_norm: PositiveFloat = 5.0
    """Larger gradients are scaled down to this norm."""
    ema_decay: _BelowOne = 0.998
    """Of the exponential moving average of the weights, which is validated and kept."""
    validation_bins: PositiveInt = 16
    """Held-out bins, and as many of bent parts if there are any in training; one view of each is measured."""
    losses: LossWeights = field(default_factory=LossWeights)
    """Weights of the loss's terms."""
    crops: CropConfig = field(default_factory=CropConfig)
    """How crops are changed."""
    data: BinDataConfig = field(default_factory=BinDataConfig)
    """What bins are drawn from."""


def read_detector_train_config(path: Path) -> DetectorTrainConfig:
    """Return the configuration in a JSON file: settings by name, or the ``config.json`` of a run.

    Raises:
        ConfigError: the file is missing, is no JSON object, or names unknown settings or values out of range.
    """
    values = read_json(path)
    return from_json(DetectorTrainConfig, values.get("training", values), str(path))
