"""The configuration of one run: every setting that its results depend on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro
from annotated_types import Interval

from simpick.config import Config, NonNegativeFloat, NonNegativeInt, PositiveInt
from simpick.errors import ConfigError
from simpick.experiments.modes import ORACLE_NOISE, Mode

# The bounds of `BinConfig`, in the unit of this configuration.
_SideMm = Annotated[float, Interval(ge=50, le=1000)]


@dataclass(frozen=True)
class CellConfig(Config):
    """Bins, gripper and detections: the settings that do not depend on the estimator.

    Episode k uses seed ``seed + k``; nothing else is random.
    """

    episodes: PositiveInt = 1
    """How many bins to pick."""
    seed: NonNegativeInt = 0
    """Seed of the first episode; episode k has seed + k."""
    parts: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="PART ...", help_behavior_hint="(default: the library)")
    ] = ()
    """Part names or mesh files that bins are filled from; a single one makes homogeneous bins."""
    count: int = 12
    """Parts per bin, 1 to 50."""
    gripper: str = "jaw"
    """Gripper on the arm: jaw, suction, or one that another package adds."""
    robot: str = "ur5e"
    """Arm: ur5e."""
    bin_mm: tuple[_SideMm, _SideMm, _SideMm] = (400.0, 300.0, 120.0)
    """Inner length (across the arm's reach), width and depth of the bin, in millimetres."""
    detections: Literal["perfect", "realistic"] = "perfect"
    """Quality of the masks that poses are estimated from."""
    randomization: str = "default"
    """Preset of lights, colours, textures and camera jitter: default, none or strong."""
    max_consecutive_failures: PositiveInt = 2
    """Failed attempts in a row that end an episode (VGN's protocol has two)."""


@dataclass(frozen=True)
class RunConfig(CellConfig):
    """A cell and the perception that picks in it."""

    perception: Annotated[str, tyro.conf.arg(name="estimator")] = "oracle"
    """oracle (true poses), an estimator that ships, or one of another package."""
    hypotheses: Annotated[
        PositiveInt | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: the estimator's own)")
    ] = None
    """How many hypotheses to ask for per part; the oracle has none."""
    noise_deg: NonNegativeFloat = 0.0
    """oracle: median rotation error added to the true poses, in degrees."""
    noise_mm: NonNegativeFloat = 0.0
    """oracle: median translation error added to the true poses, in millimetres."""
    look_closer: bool = False
    """Correct each grasp by a second image, from the wrist camera (oracle: by the true pose)."""

    def _check_rules(self) -> None:
        super()._check_rules()
        if self.perception != "oracle" and (self.noise_deg or self.noise_mm):
            raise ConfigError(f"noise_deg and noise_mm are for perception 'oracle', got perception {self.perception!r}")
        if self.perception == "oracle" and self.hypotheses is not None:
            raise ConfigError(
                f"hypotheses are for perceptions that estimate; the oracle has one pose, got {self.hypotheses}"
            )

    @property
    def mode(self) -> str:
        """Return the mode's full name: ``oracle_noise``, ``retrieval``, ``retrieval@8``, ``fine+closer``."""
        name = ORACLE_NOISE if self.noise_deg or self.noise_mm else self.perception
        return str(Mode(name, self.hypotheses, self.look_closer))
