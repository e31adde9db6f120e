"""`Machine`: what a training run uses of the machine that it runs on."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Machine:
    """What a run uses of its machine; changes nothing of the result but rounding."""

    device: str = "auto"
    """Where the network runs: cuda, cpu, or auto for the first that is there."""
    renderers: int = 1
    """Processes that make data; 0 makes it in between, in this process."""
    loaders: int = 1
    """Threads that put batches together."""
    threads: int = 0
    """Threads of torch on the CPU; 0 leaves its default."""
    validate_every_s: float = 300.0
    """Seconds between validations, each of which also saves the run's state."""
