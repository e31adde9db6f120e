"""What one run of ``simpick run`` is: everything that its results depend on."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Interval

from simpick.config import Config, NonNegativeFloat, NonNegativeInt, PositiveInt
from simpick.errors import ConfigError
from simpick.experiments.modes import ORACLE_NOISE, Mode

# The bounds of `BinConfig`, in the unit of this configuration.
_SideMm = Annotated[float, Interval(ge=50, le=1000)]


@dataclass(frozen=True)
class CellConfig(Config):
    """Bins, gripper and detections: what does not depend on who estimates poses.

    Episode k uses seed ``seed + k``; nothing else is random.
    """

    episodes: PositiveInt = 1
    """How many bins to pick."""
    seed: NonNegativeInt = 0
    """Seed of the first episode."""
    parts: tuple[str, ...] = ()
    """Part names or mesh files to draw the bin's parts from; one makes a homogeneous bin, none means the library."""
    count: int = 12
    """How many parts a bin holds, 1 to 50."""
    gripper: Literal["jaw", "suction"] = "jaw"
    """Which gripper the arm carries."""
    robot: str = "ur5e"
    """Which arm picks: ur5e."""
    bin_mm: tuple[_SideMm, _SideMm, _SideMm] = (400.0, 300.0, 120.0)
    """Inner length (across the arm's reach), width and depth of the bin, in millimetres."""
    detections: Literal["perfect", "realistic"] = "perfect"
    """How well parts are segmented in the image before their poses are estimated."""
    randomization: str = "default"
    """Preset of lights, colours, textures and camera jitter: default, none or strong."""
    max_consecutive_failures: PositiveInt = 2
    """The episode ends after this many failed attempts in a row (two is VGN's protocol)."""

    def to_json(self) -> dict[str, Any]:
        """Return a JSON object that names the run."""
        return dataclasses.asdict(self)


@dataclass(frozen=True)
class RunConfig(CellConfig):
    """A cell and the perception that it is picked with."""

    perception: str = "oracle"
    """Who estimates poses: oracle (the truth), retrieval, retrieval_refined, coarse, fine, refined, or one that another
    package registers."""
    hypotheses: PositiveInt | None = None
    """Ask the estimator for this many hypotheses a part instead of its own number; the oracle has none."""
    noise_deg: NonNegativeFloat = 0.0
    """Oracle only: median rotation error added to the true poses, in degrees."""
    noise_mm: NonNegativeFloat = 0.0
    """Oracle only: median translation error added to the true poses, in millimetres."""
    look_closer: bool = False
    """Look again through the wrist camera before descending, and correct the grasp by what the refiner sees; with the
    oracle by the true pose, which is what an ideal refiner would give."""

    def _check_rules(self) -> None:
        super()._check_rules()
        if self.perception != "oracle" and (self.noise_deg or self.noise_mm):
            raise ConfigError(f"noise_deg and noise_mm are for perception 'oracle', got perception {self.perception!r}")
        if self.perception == "oracle" and self.hypotheses is not None:
            raise ConfigError(
                f"hypotheses are for perceptions that estimate, the oracle knows one pose; got {self.hypotheses}"
            )

    @property
    def mode(self) -> str:
        """Return the perception mode's full name: ``oracle_noise``, ``retrieval``, ``retrieval@8``, ``fine+closer``."""
        name = ORACLE_NOISE if self.noise_deg or self.noise_mm else self.perception
        return str(Mode(name, self.hypotheses, self.look_closer))
