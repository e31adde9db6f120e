"""Pose estimators by name: one row for each that ships, and those that other packages register as entry points."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from simpick.config import Config, NonNegativeInt
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.base import PoseEstimator
from simpick.estimators.plugins import Plugin, entries_of, make_plugin

ENTRY_POINT_GROUP = "simpick.estimators"
"""Where another package registers its estimator: a callable that returns a `PoseEstimator`.

It is called without arguments, and for NAME@K with ``hypotheses=K``, which needs a parameter of that name.
"""
ORACLE = "oracle"
"""The name of the true poses. Whoever holds the truth makes this estimator: an environment or an annotated data set."""


@dataclass(frozen=True)
class PoseBudget(Config):
    """How much work ``coarse`` and ``fine`` do; None stands for the estimator's default."""

    iterations: NonNegativeInt | None = None
    """How many times templates are chosen around the estimator's own answer."""
    decoder_steps: NonNegativeInt | None = None
    """Denoising steps of the diffusion decoder per answer; 0 leaves it out."""


@dataclass(frozen=True)
class EstimatorName:
    """An estimator's name and the number of hypotheses asked of it, written ``NAME`` or ``NAME@K``."""

    name: str
    hypotheses: int | None = None
    """None stands for the estimator's default."""

    def __str__(self) -> str:
        return self.name if self.hypotheses is None else f"{self.name}@{self.hypotheses}"

    @staticmethod
    def parse(text: str) -> EstimatorName:
        """Return the parsed name; whether such an estimator exists is not checked.

        Raises:
            ConfigError: the text is not NAME or NAME@K, or it asks the oracle for hypotheses.
        """
        match = re.fullmatch(r"([^@+\s]+)(?:@([1-9][0-9]*))?", text)
        if match is None:
            raise ConfigError(
                "an estimator must be written NAME or NAME@K with K hypotheses, 1 or more, such as retrieval@8; "
                f"got {text!r}"
            )
        if match[1] == ORACLE and match[2]:
            raise ConfigError(f"{ORACLE} knows one pose and makes no hypotheses, got {text!r}; leave out @{match[2]}")
        return EstimatorName(match[1], None if match[2] is None else int(match[2]))


@dataclass(frozen=True)
class EstimatorSpec(Plugin):
    """How an estimator is made, and what its answers depend on."""

    make: Callable[[int | None, PoseBudget], PoseEstimator]
    """Takes the number of hypotheses, None for the default. Imports heavy libraries itself."""
    gives_probabilities: bool = False
    """Whether scores are probabilities that a pose is good enough to pick by."""
    takes_budget: bool = False


def _retrieval(hypotheses: int | None, budget: PoseBudget) -> PoseEstimator:
    from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator

    return RetrievalEstimator(None if hypotheses is None else RetrievalConfig(hypotheses=hypotheses))


def _raypose(mode: Literal["coarse", "fine"], hypotheses: int | None, budget: PoseBudget) -> PoseEstimator:
    from simpick.estimators.raypose import RayPoseEstimatorConfig, load_raypose

    asked = {"hypotheses": hypotheses, "iterations": budget.iterations, "decoder_steps": budget.decoder_steps}
    config = RayPoseEstimatorConfig(**{name: value for name, value in asked.items() if value is not None})
    return load_raypose(mode, config)


_REFINED_STARTS = 5
"""Hypotheses of the base estimator that are refined if no number is asked for."""


def _refined(
    mode: str, make_base: Callable[[int | None, PoseBudget], PoseEstimator], hypotheses: int | None, budget: PoseBudget
) -> PoseEstimator:
    from simpick.estimators.refiner import RefinedEstimator

    return RefinedEstimator(make_base(hypotheses or _REFINED_STARTS, budget), mode=mode)


def _weights() -> Path:
    from simpick.estimators.raypose.checkpoints import shipped_checkpoint

    return shipped_checkpoint()


def _confidence() -> Path:
    from simpick.estimators.refiner.confidence import SHIPPED_FILE

    return SHIPPED_FILE


SHIPPED: dict[str, EstimatorSpec] = {
    "retrieval": EstimatorSpec(_retrieval),
    "retrieval_refined": EstimatorSpec(
        partial(_refined, "retrieval_refined", _retrieval), files=(_confidence,), gives_probabilities=True
    ),
    "coarse": EstimatorSpec(partial(_raypose, "coarse"), files=(_weights,), takes_budget=True),
    "fine": EstimatorSpec(partial(_raypose, "fine"), files=(_weights,), takes_budget=True),
    "refined": EstimatorSpec(
        partial(_refined, "refined", partial(_raypose, "fine")), files=(_weights, _confidence), gives_probabilities=True
    ),
}
"""The estimators that ship with simpick and work from images alone, by name."""


def estimator_names() -> list[str]:
    """Return every name that a pose estimator can be asked for by, the oracle's included."""
    return [ORACLE, *SHIPPED, *entries_of(ENTRY_POINT_GROUP)]


def find_estimator(name: str) -> EstimatorSpec:
    """Return the row of an estimator that works from images alone.

    Raises:
        UnknownNameError: no estimator has this name; the message lists those that exist.
    """
    if name in SHIPPED:
        return SHIPPED[name]
    if (entry := entries_of(ENTRY_POINT_GROUP).get(name)) is not None:
        return EstimatorSpec(
            lambda hypotheses, budget: make_plugin(entry, PoseEstimator, hypotheses=hypotheses), entry=entry
        )
    raise UnknownNameError(
        "estimator", name, estimator_names(), f"Other packages add theirs as entry points of {ENTRY_POINT_GROUP!r}."
    )


def load_estimator(name: str, *, hypotheses: int | None = None, budget: PoseBudget | None = None) -> PoseEstimator:
    """Return the pose estimator called ``NAME`` or ``NAME@K``; it works from images alone.

    `hypotheses` says the same as K, which takes precedence. None stands for the estimator's defaults.

    Raises:
        UnknownNameError: no estimator has this name; the message lists those that exist.
        ConfigError: the name is malformed or the oracle's, or the estimator takes no number of hypotheses or no budget.
        CheckpointError: the estimator's weights are missing.
        PluginError: another package's estimator cannot be made.
    """
    parsed = EstimatorName.parse(name)
    if parsed.name == ORACLE:
        raise ConfigError("the oracle takes the true poses from an environment: make OracleEstimator(env.truth)")
    spec = find_estimator(parsed.name)
    hypotheses, budget = parsed.hypotheses or hypotheses, budget or PoseBudget()
    if budget != PoseBudget() and not spec.takes_budget:
        raise ConfigError(f"iterations and decoder are options of coarse and fine; {name!r} has none. Leave them out")
    return spec.make(hypotheses, budget)
