"""Perception modes as a comparison names them: ``retrieval``, ``retrieval@8``, ``fine+closer``, ``oracle_noise``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from simpick.errors import ConfigError, SimpickError

ORACLE, ORACLE_NOISE = "oracle", "oracle_noise"
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
        name = self.name if self.hypotheses is None else f"{self.name}@{self.hypotheses}"
        return name + CLOSER if self.look_closer else name

    @property
    def knows_truth(self) -> bool:
        """Return whether poses come from the simulator instead of from images."""
        return self.name in (ORACLE, ORACLE_NOISE)


def parse_mode(text: str) -> Mode:
    """Return the mode that is written ``NAME`` or ``NAME@K``, with ``+closer`` behind it or not.

    Raises:
        ConfigError: it is not written so, or the oracle is asked for hypotheses.
    """
    match = re.fullmatch(r"([^@+\s]+)(?:@([1-9][0-9]*))?(\+closer)?", text)
    if match is None:
        raise ConfigError(
            "a mode must be written NAME or NAME@K with K hypotheses, 1 or more, such as retrieval@8, and may end in "
            f"+closer; got {text!r}"
        )
    mode = Mode(match[1], None if match[2] is None else int(match[2]), match[3] is not None)
    if mode.knows_truth and mode.hypotheses is not None:
        raise ConfigError(f"{mode.name} knows one pose and makes no hypotheses, got {text!r}; leave out @{match[2]}")
    return mode


def check_modes(texts: Sequence[str]) -> None:
    """Check that every mode can be run, by making its estimator, and tell all that is wrong at once.

    Raises:
        ConfigError: modes are missing, misspelt, named twice, unknown, or cannot be made, for want of weights say.
    """
    # Only here, because it loads torch and MuJoCo.
    from simpick.experiments.perceptions import estimator_names, make_estimator

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
                make_estimator(mode.name, mode.hypotheses)
            seen.add(mode)
        except SimpickError as error:
            problems.append(str(error))
    if problems:
        raise ConfigError("; ".join(problems) if len(problems) == 1 else "\n  - ".join(["modes:", *problems]))
