"""Perception modes as a comparison names them: ``retrieval``, ``retrieval@8``, ``fine+closer``, ``oracle_noise``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from simpick.errors import ConfigError, SimpickError
from simpick.estimators.registry import ORACLE, EstimatorName, estimator_names, load_estimator

ORACLE_NOISE = "oracle_noise"
CLOSER = "+closer"
"""Behind a mode's name: with a second look through the wrist camera."""


@dataclass(frozen=True)
class Mode:
    """One way to estimate poses."""

    name: str
    """The estimator's name, or ``oracle_noise`` for the oracle with noise."""
    hypotheses: int | None = None
    """How many hypotheses it is asked for; None for its own number."""
    look_closer: bool = False
    """Whether the wrist camera looks again before the gripper descends."""

    def __str__(self) -> str:
        return f"{EstimatorName(self.name, self.hypotheses)}{CLOSER if self.look_closer else ''}"

    @property
    def knows_truth(self) -> bool:
        """Return whether poses come from the simulator instead of from images."""
        return self.name in (ORACLE, ORACLE_NOISE)


def parse_mode(text: str) -> Mode:
    """Return the mode that is written ``NAME`` or ``NAME@K``, with ``+closer`` behind it or not.

    Raises:
        ConfigError: it is not written so, or the oracle is asked for hypotheses.
    """
    estimator = EstimatorName.parse(text.removesuffix(CLOSER))
    if estimator.name == ORACLE_NOISE and estimator.hypotheses is not None:
        raise ConfigError(f"{ORACLE_NOISE} makes no hypotheses, got {text!r}; leave out @{estimator.hypotheses}")
    return Mode(estimator.name, estimator.hypotheses, text.endswith(CLOSER))


def check_modes(texts: Sequence[str]) -> None:
    """Check that every mode can be run, by making its estimator, and tell all that is wrong at once.

    Raises:
        ConfigError: modes are missing, misspelt, named twice, unknown, or cannot be made, for want of weights say.
    """
    problems = [] if texts else ["name one mode or more, such as: simpick compare oracle retrieval"]
    valid = sorted({*estimator_names(), ORACLE_NOISE})
    seen: set[Mode] = set()
    for text in texts:
        try:
            mode = parse_mode(text)
            if mode in seen:
                problems.append(f"{text!r} is named twice")
            elif not mode.knows_truth and mode.name not in valid:
                alike = get_close_matches(mode.name, valid, n=1)
                hint = f". Did you mean {alike[0]!r}?" if alike else ""
                problems.append(f"no mode named {mode.name!r}. Valid: {', '.join(valid)}{hint}")
            elif not mode.knows_truth:
                load_estimator(mode.name, hypotheses=mode.hypotheses)
            seen.add(mode)
        except SimpickError as error:
            problems.append(str(error))
    if problems:
        raise ConfigError("; ".join(problems) if len(problems) == 1 else "\n  - ".join(["modes:", *problems]))
