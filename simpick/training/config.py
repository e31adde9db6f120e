"""`TrainConfig`: everything that a training run depends on, beside the network's own configuration."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from annotated_types import Interval

from simpick.config import Config, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, from_json, read_json
from simpick.errors import ConfigError
from simpick.estimators.raypose.diffusion.schedule import SCHEDULES
from simpick.estimators.raypose.network.losses import LossWeights
from simpick.training.data.augmentation import AugmentationConfig
from simpick.training.data.data_config import DataConfig

_BelowOne = Annotated[float, Interval(ge=0, lt=1)]


@dataclass(frozen=True)
class TrainConfig(Config):
    """How a network is trained."""

    seed: NonNegativeInt = 0
    """Of weights, noise and the order of the data; the data itself has its own."""
    batch: PositiveInt = 32
    """Queries a step, on each process."""
    parts: PositiveInt = 4
    """Parts that they are of: queries of one part share nothing but their shard, which is read once."""
    templates: PositiveInt = 4
    """Templates a query in training; the network may be given more at run time."""
    repeats_per_query: PositiveFloat = 3.0
    """How often a query is seen on average, each time turned, framed and hidden differently, with other templates."""
    min_ready_shards: PositiveInt = 8
    """Training starts when so many shards are ready; the window grows from there."""
    window: PositiveInt = 64
    """Shards that are drawn from at a time; also the most that are in memory."""
    matching_share: _BelowOne = 0.5
    """Share of the run, at its beginning, in which only matching and the pose solved from it are trained. The decoder
    corrects that pose, and has little to learn before it is good; without it, a step costs half."""
    learning_rate: PositiveFloat = 1e-3
    """Of AdamW, after the warm-up and before it falls."""
    warmup_steps: NonNegativeInt = 200
    """Steps over which the learning rate rises from zero."""
    decay_fraction: _BelowOne = 0.35
    """Share of the run, at its end, over which the learning rate falls to a hundredth."""
    weight_decay: NonNegativeFloat = 0.01
    """Of AdamW."""
    max_grad_norm: PositiveFloat = 1.0
    """Largest norm of the gradient."""
    ema_decay: _BelowOne = 0.998
    """Of the moving average of the weights, which is what is validated and kept."""
    schedule: str = "log_snr"
    """Noise schedule: log_snr, cosine or linear."""
    losses: LossWeights = field(default_factory=LossWeights)
    """Weights of the loss's terms."""
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    """How queries are changed."""
    data: DataConfig = field(default_factory=DataConfig)
    """What they are drawn from."""
    validation_shards: PositiveInt = 10
    """Held-out parts, never trained on."""
    validation_queries: PositiveInt = 8
    """Queries of each."""
    validation_steps: PositiveInt = 3
    """Denoising steps of the sampled poses."""

    def _check_rules(self) -> None:
        if self.batch % self.parts:
            raise ConfigError(f"parts must divide batch, got parts={self.parts}, batch={self.batch}")
        if self.window < self.parts:
            raise ConfigError(f"window must hold as many shards as parts={self.parts}, got {self.window}")
        if self.schedule not in SCHEDULES:
            raise ConfigError(f"schedule must be one of {', '.join(SCHEDULES)}, got {self.schedule!r}")

    def learning_rate_at(self, step: int, progress: float) -> float:
        """Return the learning rate of a step; `progress` is the share of the run that is done, in [0, 1]."""
        rate = self.learning_rate * min(1.0, (step + 1) / max(1, self.warmup_steps))
        if self.decay_fraction and progress > 1 - self.decay_fraction:
            rate *= 0.01 ** ((progress - 1 + self.decay_fraction) / self.decay_fraction)
        return rate


def read_train_config(path: Path) -> TrainConfig:
    """Return the configuration in a JSON file: ``config.json`` of a run, or settings by name, others by default.

    Raises:
        ConfigError: the file cannot be read, or a value does not fit; the message names file and setting.
    """
    values = read_json(path)
    if values.keys() == {"network", "training"}:
        values = values["training"]
    return from_json(TrainConfig, values, str(path))
