"""`TrainConfig`: everything that a training run depends on, beside the network's own configuration."""

from __future__ import annotations

from dataclasses import dataclass, field

from simpick.errors import ConfigError
from simpick.estimators.raypose.diffusion.schedule import SCHEDULES
from simpick.estimators.raypose.network.losses import LossWeights
from simpick.training.data.augmentation import AugmentationConfig
from simpick.training.data.data_config import DataConfig


@dataclass(frozen=True)
class TrainConfig:
    """How a network is trained."""

    seed: int = 0
    """Of weights, noise and the order of the data; the data itself has its own."""
    batch: int = 32
    """Queries a step, on each process."""
    parts: int = 4
    """Parts that they are of: queries of one part share nothing but their shard, which is read once."""
    templates: int = 4
    """Templates a query in training; the network may be given more at run time."""
    repeats_per_query: float = 3.0
    """How often a query is seen on average, each time turned, framed and hidden differently, with other templates."""
    min_ready_shards: int = 8
    """Training starts when so many shards are ready; the window grows from there."""
    window: int = 64
    """Shards that are drawn from at a time; also the most that are in memory."""
    matching_share: float = 0.5
    """Share of the run, at its beginning, in which only matching and the pose solved from it are trained. The decoder
    corrects that pose, and has little to learn before it is good; without it, a step costs half."""
    learning_rate: float = 1e-3
    """Of AdamW, after the warm-up and before it falls."""
    warmup_steps: int = 200
    """Steps over which the learning rate rises from zero."""
    decay_fraction: float = 0.35
    """Share of the run, at its end, over which the learning rate falls to a hundredth."""
    weight_decay: float = 0.01
    """Of AdamW."""
    max_grad_norm: float = 1.0
    """Largest norm of the gradient."""
    ema_decay: float = 0.998
    """Of the moving average of the weights, which is what is validated and kept."""
    schedule: str = "log_snr"
    """Noise schedule: log_snr, cosine or linear."""
    losses: LossWeights = field(default_factory=LossWeights)
    """Weights of the loss's terms."""
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    """How queries are changed."""
    data: DataConfig = field(default_factory=DataConfig)
    """What they are drawn from."""
    validation_shards: int = 10
    """Held-out parts, never trained on."""
    validation_queries: int = 8
    """Queries of each."""
    validation_steps: int = 3
    """Denoising steps of the sampled poses."""

    def __post_init__(self) -> None:
        for name in (
            "batch",
            "parts",
            "templates",
            "min_ready_shards",
            "window",
            "validation_shards",
            "validation_queries",
        ):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} must be 1 or more, got {getattr(self, name)}")
        if self.batch % self.parts:
            raise ConfigError(f"parts must divide batch, got parts={self.parts}, batch={self.batch}")
        if self.window < self.parts:
            raise ConfigError(f"window must hold as many shards as parts={self.parts}, got {self.window}")
        for name in ("repeats_per_query", "learning_rate", "max_grad_norm"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be above 0, got {getattr(self, name)}")
        for name in ("matching_share", "decay_fraction", "ema_decay"):
            if not 0 <= getattr(self, name) < 1:
                raise ConfigError(f"{name} must be from 0 to below 1, got {getattr(self, name)}")
        if self.warmup_steps < 0 or self.weight_decay < 0:
            raise ConfigError(
                f"warmup_steps and weight_decay must be 0 or more, got {self.warmup_steps} and {self.weight_decay}"
            )
        if self.schedule not in SCHEDULES:
            raise ConfigError(f"schedule must be one of {', '.join(SCHEDULES)}, got {self.schedule!r}")

    def learning_rate_at(self, step: int, progress: float) -> float:
        """Return the learning rate of a step; `progress` is the share of the run that is done, in [0, 1]."""
        rate = self.learning_rate * min(1.0, (step + 1) / max(1, self.warmup_steps))
        if self.decay_fraction and progress > 1 - self.decay_fraction:
            rate *= 0.01 ** ((progress - 1 + self.decay_fraction) / self.decay_fraction)
        return rate
