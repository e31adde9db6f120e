"""Perception modes by name: ``retrieval``, ``retrieval@8``, ``fine+closer``, ``oracle_noise``, ``oracle_noise@2mm``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from simpick.errors import ConfigError, SimpickError
from simpick.estimators.registry import ORACLE, EstimatorName, estimator_names, load_estimator

ORACLE_NOISE = "oracle_noise"
CLOSER = "+closer"
"""Ends the name of a mode that corrects each grasp by a second image, from the wrist camera."""


@dataclass(frozen=True)
class Mode:
    """One way to estimate poses."""

    name: str
    """The estimator's name, or ``oracle_noise`` for the oracle with noise."""
    hypotheses: int | None = None
    """Hypotheses per part; None for the estimator's default."""
    noise: tuple[float, str] | None = None
    """Of ``oracle_noise``: median error and its unit, ``mm`` or ``deg``; None for that of the configuration."""
    look_closer: bool = False
    """Whether an image from the wrist camera corrects each grasp."""

    def __str__(self) -> str:
        noise = "" if self.noise is None else f"@{self.noise[0]:g}{self.noise[1]}"
        return f"{EstimatorName(self.name, self.hypotheses)}{noise}{CLOSER if self.look_closer else ''}"

    @property
    def knows_truth(self) -> bool:
        """Return whether poses come from the simulator instead of from images."""
        return self.name in (ORACLE, ORACLE_NOISE)


def parse_mode(text: str) -> Mode:
    """Return the mode that is written ``NAME``, ``NAME@K`` or ``oracle_noise@LEVEL``, each with or without ``+closer``.

    Raises:
        ConfigError: it is not written so, or the oracle is asked for hypotheses.
    """
    name, look_closer = text.removesuffix(CLOSER), text.endswith(CLOSER)
    if name.startswith(f"{ORACLE_NOISE}@"):
        match = re.fullmatch(rf"{ORACLE_NOISE}@(\d+\.?\d*)(mm|deg)", name)
        if match is None or float(match[1]) == 0:
            raise ConfigError(
                f"the noise of {ORACLE_NOISE} must be a number above 0 in mm or deg, such as {ORACLE_NOISE}@2.5deg; "
                f"got {text!r}"
            )
        return Mode(ORACLE_NOISE, noise=(float(match[1]), match[2]), look_closer=look_closer)
    estimator = EstimatorName.parse(name)
    return Mode(estimator.name, estimator.hypotheses, look_closer=look_closer)


def check_modes(texts: Sequence[str]) -> None:
    """Check that every mode can be run, by making its estimator, and report everything that is wrong at once.

    Raises:
        ConfigError: modes are missing, misspelt, named twice, unknown, or cannot be made, for lack of weights say.
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
