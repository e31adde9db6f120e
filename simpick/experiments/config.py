"""What is run: one perception mode, modes to compare, or a sweep over noise; and how its episodes are executed."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar

import tyro
from annotated_types import Interval

from simpick.config import Config, NonNegativeFloat, NonNegativeInt, PositiveInt
from simpick.errors import ConfigError
from simpick.experiments.modes import ORACLE, ORACLE_NOISE, Mode, check_modes, parse_mode

# The bounds of `BinConfig`, in the unit of this configuration.
_SideMm = Annotated[float, Interval(ge=50, le=1000), "give millimetres, not metres"]


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
    detections: str = "learned"
    """learned (found in the image), another package's, or simulated: perfect (an upper bound), realistic, box."""
    randomization: str = "default"
    """Preset of lights, colours, textures and camera jitter: default, none, strong or photo."""
    max_consecutive_failures: PositiveInt = 2
    """End an episode after this many picks in a row that delivered nothing, abstentions included."""

    def cell(self) -> dict[str, Any]:
        """Return the settings of the cell alone, by name."""
        return {field.name: getattr(self, field.name) for field in fields(CellConfig)}


@dataclass(frozen=True)
class RunConfig(CellConfig):
    """A cell and the perception mode that picks in it."""

    CONFIG_FILE: ClassVar = "config.json"

    estimator: str = "refined"
    """retrieval, coarse, fine, refined, retrieval_refined, another package's, or oracle: true poses, an upper bound."""
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
        if parse_mode(self.estimator) != Mode(self.estimator):
            raise ConfigError(
                f"estimator must be a name alone, got the mode {self.estimator!r} of a comparison; set hypotheses, "
                "noise_deg, noise_mm and look_closer instead"
            )
        if self.estimator != ORACLE and (self.noise_deg or self.noise_mm):
            raise ConfigError(
                f"noise_deg and noise_mm are for estimator 'oracle', got estimator {self.estimator!r}; add "
                "--estimator oracle"
            )
        if self.estimator == ORACLE and self.hypotheses is not None:
            raise ConfigError(f"the oracle knows one pose and makes no hypotheses, got hypotheses={self.hypotheses}")

    @property
    def detections_used(self) -> str:
        """Return the detections' name: with the oracle simulated ones, since true poses belong to instances."""
        # Only here: it loads OpenCV.
        from simpick.estimators.detections import is_simulated

        return self.detections if self.estimator != ORACLE or is_simulated(self.detections) else "perfect"

    @property
    def mode(self) -> str:
        """Return the perception mode's full name, such as ``retrieval@8``, ``fine+closer`` or ``oracle_noise@2mm``."""
        if not (self.noise_deg or self.noise_mm):
            return str(Mode(self.estimator, self.hypotheses, look_closer=self.look_closer))
        noise = None
        if not (self.noise_deg and self.noise_mm):
            noise = (self.noise_deg, "deg") if self.noise_deg else (self.noise_mm, "mm")
        return str(Mode(ORACLE_NOISE, noise=noise, look_closer=self.look_closer))

    def runs(self) -> dict[str, RunConfig]:
        """Return this run by the name of its mode."""
        return {self.mode: self}


@dataclass(frozen=True)
class CompareConfig(CellConfig):
    """Modes that pick the same bins: episode k is the bin of seed ``seed + k`` for each of them."""

    CONFIG_FILE: ClassVar = "compare.json"

    modes: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="MODE ...")] = (
        ORACLE,
        "fine",
        "refined",
    )
    """NAME, NAME@K with K hypotheses per part, oracle_noise@2mm or oracle_noise@5deg, each also with +closer."""
    episodes: PositiveInt = 10
    """How many bins each mode picks."""
    noise_deg: NonNegativeFloat = 5.0
    """oracle_noise: median rotation error added to the true poses, in degrees."""
    noise_mm: NonNegativeFloat = 5.0
    """oracle_noise: median translation error added to the true poses, in millimetres."""

    def _check_rules(self) -> None:
        super()._check_rules()
        if self.noise_deg == self.noise_mm == 0:
            raise ConfigError("noise_deg and noise_mm must not both be 0 (that is the mode oracle), got 0 and 0")

    def runs(self) -> dict[str, RunConfig]:
        """Return the run of each mode by the mode's full name, in the order of `modes`.

        Raises:
            ConfigError: a mode is missing, misspelt, named twice, unknown, or cannot be made.
        """
        check_modes(self.modes)
        runs = [self._run(parse_mode(mode)) for mode in self.modes]
        return {run.mode: run for run in runs}

    def _run(self, mode: Mode) -> RunConfig:
        settings = self.cell()
        if mode.name != ORACLE_NOISE:
            settings |= {"estimator": mode.name, "hypotheses": mode.hypotheses}
        elif mode.noise is None:
            settings |= {"estimator": ORACLE, "noise_deg": self.noise_deg, "noise_mm": self.noise_mm}
        else:
            level, unit = mode.noise
            settings |= {"estimator": ORACLE, f"noise_{unit}": level}
        return RunConfig(**settings, look_closer=mode.look_closer)


@dataclass(frozen=True)
class SweepConfig(CellConfig):
    """Levels of noise on true poses: translation without rotation, and rotation without translation."""

    detections: str = "perfect"
    """perfect, realistic or box: true poses belong to the simulator's instances, so a sweep is an upper bound."""
    episodes: PositiveInt = 4
    """How many bins to pick at each level."""
    levels_mm: tuple[NonNegativeFloat, ...] = (0.0, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0)
    """Median translation errors, in millimetres."""
    levels_deg: tuple[NonNegativeFloat, ...] = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0)
    """Median rotation errors, in degrees."""

    def steps(self) -> list[tuple[str, float, str]]:
        """Return unit, level and mode of each step."""
        levels = [("mm", level) for level in self.levels_mm] + [("deg", level) for level in self.levels_deg]
        return [
            (unit, level, str(Mode(ORACLE_NOISE, noise=(level, unit)) if level else Mode(ORACLE)))
            for unit, level in levels
        ]

    def comparison(self) -> CompareConfig:
        """Return the comparison of all levels over the same bins."""
        return CompareConfig(**self.cell(), modes=tuple(dict.fromkeys(mode for *_, mode in self.steps())))


@dataclass(frozen=True)
class Execution(Config):
    """Where episodes run, and what they leave beside their results."""

    record: bool = False
    """Write one rerun recording per episode."""
    overwrite: bool = False
    """Replace results in the folder --out instead of resuming them."""
    workers: PositiveInt = 1
    """Episodes to run at the same time, each in its own process; perception takes longer then."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS", help_behavior_hint="(default: no cluster)")] = None
    """Address of a Ray cluster: HOST:PORT, auto, or local for one on this machine."""

    def _check_rules(self) -> None:
        super()._check_rules()
        if self.ray is not None and self.workers != 1:
            raise ConfigError(f"workers are for this machine, a Ray cluster has its own; got {self.workers} with --ray")
