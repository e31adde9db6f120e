"""What one run of ``simpick run`` is: everything that its results depend on."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

from simpick.errors import ConfigError
from simpick.experiments.modes import ORACLE_NOISE, Mode

SHORTEST_MM, LONGEST_MM = 50.0, 1000.0
"""Bounds of a bin's sides, those of `BinConfig` in the unit of this configuration."""


@dataclass(frozen=True)
class CellConfig:
    """Bins, gripper and detections: what does not depend on who estimates poses.

    Episode k uses seed ``seed + k``; nothing else is random.
    """

    episodes: int = 1
    """How many bins to pick."""
    seed: int = 0
    """Seed of the first episode."""
    parts: tuple[str, ...] = ()
    """Part names or mesh files to draw the bin's parts from; one makes a homogeneous bin, none means the library."""
    count: int = 12
    """How many parts a bin holds, 1 to 50."""
    gripper: Literal["jaw", "suction"] = "jaw"
    """Which gripper the arm carries."""
    robot: str = "ur5e"
    """Which arm picks: ur5e."""
    bin_mm: tuple[float, float, float] = (400.0, 300.0, 120.0)
    """Inner length (across the arm's reach), width and depth of the bin, in millimetres."""
    detections: Literal["perfect", "realistic"] = "perfect"
    """How well parts are segmented in the image before their poses are estimated."""
    randomization: str = "default"
    """Preset of lights, colours, textures and camera jitter: default, none or strong."""
    max_consecutive_failures: int = 2
    """The episode ends after this many failed attempts in a row (two is VGN's protocol)."""

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigError(f"episodes must be 1 or more, got {self.episodes}")
        if self.seed < 0:
            raise ConfigError(f"seed must be 0 or more, got {self.seed}")
        if not all(SHORTEST_MM <= side <= LONGEST_MM for side in self.bin_mm):
            raise ConfigError(
                f"bin_mm must be between {SHORTEST_MM:g} and {LONGEST_MM:g} millimetres a side, "
                f"got {', '.join(f'{side:g}' for side in self.bin_mm)}"
            )
        if self.max_consecutive_failures < 1:
            raise ConfigError(f"max_consecutive_failures must be 1 or more, got {self.max_consecutive_failures}")

    def to_json(self) -> dict[str, Any]:
        """Return a JSON object that names the run."""
        return dataclasses.asdict(self)


@dataclass(frozen=True)
class RunConfig(CellConfig):
    """A cell and the perception that it is picked with."""

    perception: str = "oracle"
    """Who estimates poses: oracle (the truth), retrieval, retrieval_refined, coarse, fine, refined, or one that another
    package registers."""
    hypotheses: int | None = None
    """Ask the estimator for this many hypotheses a part instead of its own number; the oracle has none."""
    noise_deg: float = 0.0
    """Oracle only: median rotation error added to the true poses, in degrees."""
    noise_mm: float = 0.0
    """Oracle only: median translation error added to the true poses, in millimetres."""
    look_closer: bool = False
    """Look again through the wrist camera before descending, and correct the grasp by what the refiner sees; with the
    oracle by the true pose, which is what an ideal refiner would give."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.perception != "oracle" and (self.noise_deg or self.noise_mm):
            raise ConfigError(f"noise_deg and noise_mm are for perception 'oracle', got perception {self.perception!r}")
        if self.hypotheses is not None and self.hypotheses < 1:
            raise ConfigError(f"hypotheses must be 1 or more, got {self.hypotheses}")
        if self.perception == "oracle" and self.hypotheses is not None:
            raise ConfigError(
                f"hypotheses are for perceptions that estimate, the oracle knows one pose; got {self.hypotheses}"
            )

    @property
    def mode(self) -> str:
        """Return the perception mode's full name: ``oracle_noise``, ``retrieval``, ``retrieval@8``, ``fine+closer``."""
        name = ORACLE_NOISE if self.noise_deg or self.noise_mm else self.perception
        return str(Mode(name, self.hypotheses, self.look_closer))
