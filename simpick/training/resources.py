"""`Resources`: what a training run uses of the machine that it runs on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from simpick.config import Config, NonNegativeFloat, NonNegativeInt


@dataclass(frozen=True)
class Resources(Config):
    """What a run uses of its machine; changes nothing of the result but rounding."""

    device: str = "auto"
    """Where the network runs: cuda, cpu, or auto for the first that is there."""
    renderers: NonNegativeInt = 1
    """Distributed that make data; 0 makes it in between, in this process."""
    loaders: NonNegativeInt = 1
    """Threads that put batches together."""
    threads: NonNegativeInt = 0
    """Threads of torch on the CPU; 0 leaves its default."""
    validate_every_s: NonNegativeFloat = 300.0
    """Seconds between validations, each of which also saves the run's state."""
    shards: Path | None = None
    """Folder in which data is kept for other runs on the same data; without it, data lies in the run's own folder and
    is deleted when it was used."""
