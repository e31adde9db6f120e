"""`TrainConfig`: the settings of a training run, except for those of the network."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Interval

from simpick.config import Config, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, from_json, read_json
from simpick.errors import ConfigError
from simpick.estimators.raypose.network.loss_weights import LossWeights
from simpick.training.data.augmentation import AugmentationConfig
from simpick.training.data.data_config import DataConfig
from simpick.training.learning_rate import WarmupAndDecay

_BelowOne = Annotated[float, Interval(ge=0, lt=1)]


@dataclass(frozen=True)
class TrainConfig(WarmupAndDecay, Config):
    """How a network is trained."""

    seed: NonNegativeInt = 0
    """Seed of weights, noise and the order of the data; the data has its own."""
    batch: PositiveInt = 32
    """Queries per step, on each process."""
    parts: PositiveInt = 4
    """Parts that the queries of a step are of; divides the batch."""
    templates: PositiveInt = 4
    """Templates per query in training; at run time the network takes its own number."""
    repeats_per_query: PositiveFloat = 3.0
    """How often a query is used on average, each time augmented differently and with other templates."""
    min_ready_shards: PositiveInt = 8
    """Training starts when this many shards are ready."""
    window: PositiveInt = 64
    """Shards that batches are drawn from at a time, and the most in memory."""
    matching_share: _BelowOne = 0.5
    """Share of the run, at its start, that trains only the matching, which the decoder depends on."""
    learning_rate: PositiveFloat = 1e-3
    """Learning rate of AdamW between warm-up and decay."""
    warmup_steps: NonNegativeInt = 200
    """Steps over which the learning rate rises from zero."""
    decay_fraction: _BelowOne = 0.35
    """Share of the run, at its end, over which the learning rate falls to a hundredth."""
    weight_decay: NonNegativeFloat = 0.01
    """Weight decay of AdamW."""
    max_grad_norm: PositiveFloat = 1.0
    """Gradients are clipped to this norm."""
    ema_decay: _BelowOne = 0.998
    """Decay of the moving average of the weights, which is validated and saved."""
    schedule: Literal["log_snr", "cosine", "linear"] = "log_snr"
    """Noise schedule."""
    losses: LossWeights = field(default_factory=LossWeights)
    """Weights of the terms of the loss."""
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    """How queries are augmented."""
    data: DataConfig = field(default_factory=DataConfig)
    """How training data are made."""
    validation_shards: PositiveInt = 10
    """Held-out parts to validate on."""
    validation_queries: PositiveInt = 8
    """Queries per held-out part."""
    validation_steps: PositiveInt = 3
    """Denoising steps in validation."""

    def _check_rules(self) -> None:
        if self.batch % self.parts:
            raise ConfigError(f"parts must divide batch, got parts={self.parts}, batch={self.batch}")
        if self.window < self.parts:
            raise ConfigError(f"window must hold as many shards as parts={self.parts}, got {self.window}")


def read_train_config(path: Path) -> TrainConfig:
    """Return the configuration in a JSON file: ``config.json`` of a run, or settings by name, others by default.

    Raises:
        ConfigError: the file cannot be read, or a value does not fit; the message names file and setting.
    """
    values = read_json(path)
    if values.keys() == {"network", "training"}:
        values = values["training"]
    return from_json(TrainConfig, values, str(path))
