"""``results.jsonl``: one line an episode, complete after every episode, resumable after a kill."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simpick.caching import atomic_write_text
from simpick.errors import OutputError
from simpick.experiments.provenance_changes import changes
from simpick.records import PickOutcome, PickRecord, PoseError

RESULTS_FILE = "results.jsonl"
CONFIG_FILE = "config.json"


@dataclass(frozen=True)
class EpisodeResult:
    """One bin, from filled to ended."""

    episode: int
    seed: int
    instances: tuple[str, ...]
    """Part name of each instance that lay in the bin at the start."""
    picks: tuple[PickRecord, ...]
    ended: str
    """Why the episode ended: ``cleared``, ``consecutive_failures``, ``max_picks`` or ``simulation_fault``."""
    timings_s: dict[str, float] = dataclasses.field(default_factory=dict)
    """Wall-clock seconds of the whole episode (``wall``) and of making the scene (``reset``)."""
    mode: str = ""
    """Full name of the perception mode that picked, such as ``retrieval@8``; see `RunConfig.mode`."""

    @property
    def key(self) -> tuple[int, str]:
        """Return what tells this result from the others in one folder: bin and perception mode."""
        return self.episode, self.mode

    @property
    def delivered(self) -> int:
        """Return how many parts reached the chute."""
        return sum(len(pick.delivered) for pick in self.picks)

    def summary(self) -> dict[str, Any]:
        """Return the figures of the whole episode."""
        successes = sum(pick.outcome is PickOutcome.SUCCESS for pick in self.picks)
        return {
            "ended": self.ended,
            "attempts": len(self.picks),
            "successes": successes,
            "delivered": self.delivered,
            "parts": len(self.instances),
        }

    def to_json(self, *, timings: bool = True) -> dict[str, Any]:
        """Return a JSON object; without `timings` it is a pure function of the configuration and the seed."""
        line = dataclasses.asdict(self)
        if not timings:
            line.pop("timings_s")
            for pick in line["picks"]:
                pick.pop("timings_s")
        return line

    @staticmethod
    def from_json(line: dict[str, Any]) -> EpisodeResult:
        """Return the result that `to_json` wrote."""
        picks = tuple(pick_from_json(pick) for pick in line["picks"])
        # Lines of versions that knew no modes lack theirs: they are refused, for their mode is anybody's guess.
        return EpisodeResult(**{**line, "instances": tuple(line["instances"]), "picks": picks, "mode": line["mode"]})


def pick_from_json(pick: dict[str, Any]) -> PickRecord:
    """Return the `PickRecord` behind a JSON object."""
    error = pick["pose_error"]
    return PickRecord(
        **{
            **pick,
            "outcome": PickOutcome(pick["outcome"]),
            "delivered": tuple(pick["delivered"]),
            "ejected": tuple(pick["ejected"]),
            "stages": tuple(pick["stages"]),
            "gripped": tuple(pick["gripped"]),
            "pose_error": None if error is None else PoseError(**error),
        }
    )


class ResultStore:
    """A folder of results that belongs to one configuration.

    A JSON file names the configuration; ``results.jsonl`` holds the finished episodes in order and is replaced
    atomically after each, so that a kill at any moment loses no finished episode.
    """

    def __init__(
        self, folder: Path, config: dict[str, Any], *, overwrite: bool = False, config_file: str = CONFIG_FILE
    ) -> None:
        """Open `folder`, made if missing.

        More ``episodes`` or more ``modes`` of the same configuration go on with those that are there.

        Raises:
            OutputError: the folder cannot be written, holds other files, or holds results of another configuration.
        """
        self.folder = folder
        self._config_file = folder / config_file
        self.config: dict[str, Any] = json.loads(json.dumps(config))
        """What the configuration file states."""
        self._results: dict[tuple[int, str], EpisodeResult] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if overwrite:
                self._remove_own_files()
            self._open(unexpected_files_allowed=overwrite)
        except OutputError:
            raise
        except OSError as error:
            is_file = isinstance(error, FileExistsError | NotADirectoryError)
            reason = "a file is in the way" if is_file else error.strerror or str(error)
            raise OutputError(
                f"results cannot be written to {folder}: {reason}. Choose a folder that you may write with --out"
            ) from error

    def _open(self, *, unexpected_files_allowed: bool) -> None:
        config_file = self._config_file
        if not config_file.exists():
            unexpected_files = sorted(f.name for f in self.folder.iterdir())
            if unexpected_files and not unexpected_files_allowed:
                raise OutputError(
                    f"{self.folder} must be empty or hold results of simpick, it holds "
                    f"{', '.join(unexpected_files[:5])}. "
                    "Choose another folder with --out"
                )
            atomic_write_text(config_file, json.dumps(self.config, indent=2) + "\n")
            return
        previous = _read_config(config_file)
        if differing := changes(previous, self.config):
            raise OutputError(
                f"{self.folder} holds results of another configuration: {', '.join(differing)}. They are left as they "
                "are. Choose another folder with --out, or --overwrite to replace them"
            )
        if previous != self.config:
            atomic_write_text(config_file, json.dumps(self.config, indent=2) + "\n")
        results_file = self.folder / RESULTS_FILE
        if results_file.exists():
            for result in read_results(results_file):
                self._results[result.key] = result

    def _remove_own_files(self) -> None:
        for pattern in (self._config_file.name, RESULTS_FILE, "*.rrd", "*.rrd.partial", "*.rrd.room"):
            for file in self.folder.glob(pattern):
                file.unlink()

    @property
    def results(self) -> tuple[EpisodeResult, ...]:
        """Return the finished episodes in order, those of one bin by the name of their mode."""
        return _in_order(self._results)

    def __contains__(self, key: tuple[int, str]) -> bool:
        return key in self._results

    def add(self, result: EpisodeResult) -> None:
        """Keep a finished episode, on disk before this returns.

        Raises:
            OutputError: the disk is full or gone; what was kept before stays.
        """
        results = self._results | {result.key: result}
        lines = [json.dumps(r.to_json()) + "\n" for r in _in_order(results)]
        try:
            atomic_write_text(self.folder / RESULTS_FILE, "".join(lines))
        except OSError as error:
            raise OutputError(
                f"episode {result.episode} of {result.mode} could not be written to {self.folder}: "
                f"{error.strerror or error}. The {len(self._results)} episodes finished before it are kept: make room "
                "and run the same command again to go on"
            ) from error
        self._results = results


def _in_order(results: dict[tuple[int, str], EpisodeResult]) -> tuple[EpisodeResult, ...]:
    return tuple(results[key] for key in sorted(results))


def _read_config(file: Path) -> dict[str, Any]:
    try:
        config = json.loads(file.read_text())
    except ValueError:
        config = None
    if not isinstance(config, dict):
        raise OutputError(
            f"{file} does not name a configuration of simpick, so nothing can be added to the results beside it. "
            "Choose another folder with --out, or --overwrite to replace them"
        )
    return config


def read_results(file: Path) -> list[EpisodeResult]:
    """Return the episodes in a ``results.jsonl``.

    Raises:
        OutputError: a line is not an episode; the message names it.
    """
    results = []
    for number, line in enumerate(file.read_text().splitlines(), start=1):
        try:
            results.append(EpisodeResult.from_json(json.loads(line)))
        except (ValueError, KeyError, TypeError) as error:
            raise OutputError(
                f"{file}, line {number}, is not an episode of this version of simpick ({error}). "
                "Remove that line to run its episode again, or use --overwrite"
            ) from error
    return results
