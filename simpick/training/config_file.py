"""Training configurations as JSON: what a run's folder keeps, and what `simpick train --config` reads."""

from __future__ import annotations

import dataclasses
import json
import typing
from pathlib import Path
from typing import Any

from simpick.errors import ConfigError
from simpick.training.config import TrainConfig


def load_train_config(path: Path) -> TrainConfig:
    """Return the configuration in a file; settings that it does not name have their defaults.

    The file holds the settings by name, those of a group as an object of its own, or is the ``config.json`` of a run,
    whose ``training`` is taken.

    Raises:
        ConfigError: the file is missing or no JSON object, a setting is unknown, or a value is out of range.
    """
    try:
        values = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} must be a JSON file of training settings, cannot be read ({error})") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path} must hold a JSON object, got {type(values).__name__}")
    if values.keys() == {"network", "training"}:
        values = values["training"]
    return _build(TrainConfig, values, str(path))


def _build(kind: type, values: Any, where: str) -> Any:
    hints = typing.get_type_hints(kind)
    known = {field.name for field in dataclasses.fields(kind)}
    if not isinstance(values, dict):
        raise ConfigError(f"{where} must be an object with settings, got {values!r}")
    if unknown := sorted(values.keys() - known):
        raise ConfigError(f"unknown settings in {where}: {', '.join(unknown)}. Settings: {', '.join(sorted(known))}")
    given = {}
    for name, value in values.items():
        if dataclasses.is_dataclass(hints[name]) and isinstance(hints[name], type):
            value = _build(hints[name], value, f"{where}: {name}")
        given[name] = tuple(value) if isinstance(value, list) else value
    try:
        return kind(**given)
    except TypeError as error:
        raise ConfigError(f"a setting in {where} has a value of another kind than it must have: {error}") from error
