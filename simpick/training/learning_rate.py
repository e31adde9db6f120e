"""The learning rate over a run: a linear warm-up, a constant part, and an exponential decay at the end."""

from __future__ import annotations


class WarmupAndDecay:
    """Adds `learning_rate_at` to a configuration with these fields."""

    learning_rate: float
    warmup_steps: int
    decay_fraction: float

    def learning_rate_at(self, step: int, progress: float) -> float:
        """Return the learning rate of a step; `progress` is the finished share of the run, in [0, 1]."""
        rate = self.learning_rate * min(1.0, (step + 1) / max(1, self.warmup_steps))
        if self.decay_fraction and progress > 1 - self.decay_fraction:
            rate *= 0.01 ** ((progress - 1 + self.decay_fraction) / self.decay_fraction)
        return rate
