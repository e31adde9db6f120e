"""`Resources`: what a training run uses of the machine that it runs on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from simpick.config import Config, NonNegativeFloat, NonNegativeInt


@dataclass(frozen=True)
class Resources(Config):
    """What a run uses of its machine; results do not depend on it, except for rounding."""

    device: Literal["auto", "cuda", "cpu"] = "auto"
    """Where the network runs: cuda, cpu, or auto for CUDA where there is a GPU."""
    renderers: NonNegativeInt = 1
    """Processes that render data; 0 renders in the training process."""
    loaders: NonNegativeInt = 0
    """Processes that prepare batches; 0 prepares them in the training process."""
    threads: NonNegativeInt = 0
    """Threads of torch on the CPU; 0 leaves torch's default."""
    validate_every_s: NonNegativeFloat = 300.0
    """Seconds between validations, each of which also saves the state to resume from."""
    shards: Annotated[
        Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="(default: in the run's folder)")
    ] = None
    """Folder to keep data in, for other runs on the same data; the run's own is emptied as data are used."""
