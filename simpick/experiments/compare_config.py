"""The configuration of a comparison: the modes, and the bins that each of them picks."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

import tyro

from simpick.config import NonNegativeFloat
from simpick.errors import ConfigError
from simpick.experiments.modes import ORACLE, ORACLE_NOISE, Mode, check_modes, parse_mode
from simpick.experiments.run_config import CellConfig, RunConfig


@dataclass(frozen=True)
class CompareConfig(CellConfig):
    """Modes that pick the same bins: episode k is the bin of seed ``seed + k`` for each of them."""

    modes: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="MODE ...")] = (
        ORACLE,
        ORACLE_NOISE,
        "retrieval",
    )
    """NAME, NAME@K with K hypotheses per part, or either with +closer, such as refined@8+closer."""
    episodes: int = 10
    """How many bins each mode picks."""
    noise_deg: NonNegativeFloat = 5.0
    """oracle_noise: median rotation error added to the true poses, in degrees."""
    noise_mm: NonNegativeFloat = 5.0
    """oracle_noise: median translation error added to the true poses, in millimetres."""

    def _check_rules(self) -> None:
        super()._check_rules()
        if self.noise_deg == self.noise_mm == 0:
            raise ConfigError("noise_deg and noise_mm must not both be 0 (that is the mode oracle), got 0 and 0")

    def run_configs(self) -> dict[str, RunConfig]:
        """Return the run of each mode, by the mode's full name.

        Raises:
            ConfigError: a mode is missing, misspelt, named twice, unknown, or cannot be made.
        """
        check_modes(self.modes)
        return {str(mode): self._run_config(mode) for mode in map(parse_mode, self.modes)}

    def _run_config(self, mode: Mode) -> RunConfig:
        cell = {field.name: getattr(self, field.name) for field in fields(CellConfig)}
        if mode.name == ORACLE_NOISE:
            return RunConfig(
                **cell,
                perception=ORACLE,
                noise_deg=self.noise_deg,
                noise_mm=self.noise_mm,
                look_closer=mode.look_closer,
            )
        return RunConfig(**cell, perception=mode.name, hypotheses=mode.hypotheses, look_closer=mode.look_closer)
