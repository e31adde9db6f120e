"""`RunFolder`: what a training run leaves behind: configuration, log, state to go on from, weights, shards."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import torch

from simpick.caching import atomic_write_bytes, atomic_write_text
from simpick.errors import ConfigError, OutputError


class RunFolder:
    """One run's files."""

    LOG = "log.jsonl"
    """Name of the log, one JSON object a line."""

    def __init__(self, folder: Path, identity: dict[str, Any], rank: int = 0) -> None:
        """Take a folder, made if missing.

        Raises:
            ConfigError: it holds a run of another configuration.
            OutputError: it cannot be written.
        """
        self.folder, self._rank = folder, rank
        self.weights = folder / "weights.safetensors"
        """Averaged weights, as an estimator loads them."""
        self.log_file = folder / self.LOG
        self.shards = folder / "shards"
        self._state, self._config = folder / "state.pt", folder / "config.json"
        identity = json.loads(json.dumps(identity))
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if self._config.exists():
                found = json.loads(self._config.read_text())
                if found != identity:
                    raise ConfigError(
                        f"{folder} holds a run with another {', '.join(_differences(found, identity))}; "
                        "choose another folder with --out"
                    )
            elif rank == 0:
                atomic_write_text(self._config, json.dumps(identity, indent=2) + "\n")
        except (OSError, ValueError) as error:
            if isinstance(error, ConfigError):
                raise
            raise OutputError(f"a run cannot be kept in {folder}: {error}. Choose another with --out") from error

    def load_state(self) -> dict[str, Any] | None:
        """Return the state that was saved last, None if there is none; raises ConfigError if it is damaged."""
        if not self._state.exists():
            return None
        try:
            return torch.load(self._state, map_location="cpu", weights_only=True)
        except Exception as error:
            raise ConfigError(
                f"{self._state} is damaged ({error}); delete it to begin anew, from {self.weights.name} if you like"
            ) from error

    def save_state(self, state: dict[str, Any]) -> None:
        """Replace the saved state as a whole."""
        buffer = io.BytesIO()
        torch.save(state, buffer)
        atomic_write_bytes(self._state, buffer.getvalue())

    def log(self, row: dict[str, Any]) -> None:
        """Append one row."""
        with self.log_file.open("a") as file:
            file.write(json.dumps(row) + "\n")


def _differences(found: Any, wanted: Any, prefix: str = "") -> list[str]:
    """Return the dotted names of the settings that differ."""
    if not (isinstance(found, dict) and isinstance(wanted, dict)):
        return [prefix]
    names = []
    for key in sorted(found.keys() | wanted.keys()):
        if found.get(key) != wanted.get(key):
            names += _differences(found.get(key), wanted.get(key), f"{prefix}.{key}" if prefix else key)
    return names
