"""`TrainingFolder`: what a training run leaves behind: configuration, log, state to resume from, weights, shards."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import torch

from simpick.errors import ConfigError
from simpick.run_folder import RunFolder
from simpick.training.state import TrainingState


class TrainingFolder(RunFolder):
    """The files of one training run."""

    LOG = "log.jsonl"
    """Name of the log, one JSON object per line."""

    def __init__(self, path: Path, provenance: dict[str, Any], rank: int = 0) -> None:
        """Open a folder, made if missing; only the process of rank 0 writes.

        Raises:
            OutputError: it holds a run of another configuration, or cannot be written.
        """
        super().__init__(path, provenance, is_owner=rank == 0)
        self.weights = path / "weights.safetensors"
        """Averaged weights, as an estimator loads them."""
        self.shards = path / "shards"
        self._state = path / "state.pt"

    def load_state(self) -> dict[str, Any] | None:
        """Return the state that was saved last, None if there is none; raises ConfigError if it is damaged."""
        if not self._state.exists():
            return None
        try:
            return torch.load(self._state, map_location="cpu", weights_only=True)
        except Exception as error:
            raise ConfigError(
                f"{self._state} is damaged ({error}); delete it to start again, if you like with "
                f"--start-from {self.weights.name}"
            ) from error

    def restore(self, state: TrainingState[Any], saved: dict[str, Any]) -> None:
        """Continue from a state that `load_state` returned.

        Raises:
            ConfigError: it is of another network or version.
        """
        try:
            state.load(saved)
        except (KeyError, ValueError, RuntimeError, TypeError, AttributeError, IndexError, OverflowError) as error:
            raise ConfigError(
                f"the run in {self.path} is of another version of simpick and cannot be resumed; choose another folder,"
                f" and start from {self.weights} with --start-from"
            ) from error

    def save_state(self, state: dict[str, Any]) -> None:
        """Replace the saved state as a whole."""
        buffer = io.BytesIO()
        torch.save(state, buffer)
        self.write(self._state.name, buffer.getvalue())

    def log(self, row: dict[str, Any]) -> None:
        """Append one row to the log."""
        self.append(self.LOG, row)
