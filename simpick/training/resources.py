"""`Resources`: what a training run uses of the machine that it runs on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from simpick.errors import ConfigError


@dataclass(frozen=True)
class Resources:
    """What a run uses of its machine; changes nothing of the result but rounding."""

    device: str = "auto"
    """Where the network runs: cuda, cpu, or auto for the first that is there."""
    renderers: int = 1
    """Distributed that make data; 0 makes it in between, in this process."""
    loaders: int = 1
    """Threads that put batches together."""
    threads: int = 0
    """Threads of torch on the CPU; 0 leaves its default."""
    validate_every_s: float = 300.0
    """Seconds between validations, each of which also saves the run's state."""
    shards: Path | None = None
    """Folder in which data is kept for other runs on the same data; without it, data lies in the run's own folder and
    is deleted when it was used."""

    def __post_init__(self) -> None:
        for name in ("renderers", "loaders", "threads"):
            if getattr(self, name) < 0:
                raise ConfigError(f"{name} must be 0 or more, got {getattr(self, name)}")
        if not (math.isfinite(self.validate_every_s) and self.validate_every_s >= 0):
            raise ConfigError(f"validate_every_s must be 0 or more, got {self.validate_every_s}")
