"""`Budget`: when a training run ends."""

from __future__ import annotations

from dataclasses import dataclass

from simpick.config import Config, PositiveFloat, PositiveInt
from simpick.errors import ConfigError


@dataclass(frozen=True)
class Budget(Config):
    """Steps and time over all resumptions of a run; the limit that is reached first ends it."""

    minutes: PositiveFloat | None = None
    """Wall-clock time of training, including the time spent waiting for data, without validation."""
    steps: PositiveInt | None = None
    """Optimiser steps."""

    def _check_rules(self) -> None:
        if self.minutes is None and self.steps is None:
            raise ConfigError("a run needs an end: give minutes or steps")

    def progress(self, step: int, seconds: float) -> float:
        """Return the fraction of the budget that is spent; 1 or more at the end of the run."""
        by_steps = step / self.steps if self.steps else 0.0
        by_time = seconds / (60 * self.minutes) if self.minutes else 0.0
        return max(by_steps, by_time)
