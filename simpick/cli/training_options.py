"""Options that ``simpick train`` and ``simpick ablate`` share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import tyro

from simpick.config import NonNegativeInt, PositiveFloat, PositiveInt
from simpick.estimators.raypose.network.config import PRESETS, RayPoseConfig
from simpick.training.config import TrainConfig, read_train_config
from simpick.training.resources import Resources

_Options = TypeVar("_Options", bound="TrainingOptions")
_NO_LIMIT = "(default: no limit)"


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """Network, training and resources. Some options set the defaults of others; see `defaults`."""

    size: Literal["tiny", "small", "base", "paper"] = "small"
    """Preset of the options --network.*: tiny is for tests, base and paper need a GPU."""
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none)")] = None
    """JSON file with the defaults of the options --training.*: a run's config.json, or parts of one."""
    seed: NonNegativeInt = 0
    """Default of --training.seed and --training.data.seed: weights, noise, parts and bins."""
    minutes: Annotated[PositiveFloat | None, tyro.conf.arg(metavar="FLOAT", help_behavior_hint=_NO_LIMIT)] = None
    """Minutes to train, resumptions included."""
    steps: Annotated[PositiveInt | None, tyro.conf.arg(metavar="INT", help_behavior_hint=_NO_LIMIT)] = None
    """Steps to train, resumptions included."""
    resources: tyro.conf.OmitArgPrefixes[Resources] = field(default_factory=Resources)
    """What to use of this machine."""
    training: TrainConfig = field(default_factory=TrainConfig)
    """How to train."""
    network: RayPoseConfig = field(default_factory=RayPoseConfig)
    """The network; defaults of the chosen size."""

    @classmethod
    def defaults(cls: type[_Options], arguments: Sequence[str]) -> _Options:
        """Return the options with the defaults that follow from --size, --config and --seed among the arguments.

        Raises:
            ConfigError: the file cannot be read, or does not hold settings of training.
        """
        size, file, seed = (value_of(option, arguments) for option in ("--size", "--config", "--seed"))
        options = cls()
        if size in PRESETS:
            options = replace(options, size=size)
        training = read_train_config(Path(file)) if file else options.training
        if seed is not None and seed.isdecimal():
            training = replace(training, seed=int(seed), data=replace(training.data, seed=int(seed)))
        return replace(options, seed=training.seed, training=training, network=PRESETS[options.size])


def value_of(option: str, arguments: Sequence[str]) -> str | None:
    """Return the value that an option has in the arguments, None if it is not among them."""
    for argument, following in reversed([*zip_longest(arguments, arguments[1:])]):
        name, sign, value = argument.partition("=")
        if name == option:
            return value if sign else following
    return None
