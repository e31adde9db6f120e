"""``results.jsonl``: one line an episode, complete after every episode, resumable after a kill."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simpick.caching import atomic_write_text
from simpick.errors import OutputError
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
        return EpisodeResult(**{**line, "instances": tuple(line["instances"]), "picks": picks})


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

    ``config.json`` names the configuration; ``results.jsonl`` holds the finished episodes in order and is replaced
    atomically after each, so that a kill at any moment loses no finished episode.
    """

    def __init__(self, folder: Path, config: dict[str, Any], *, overwrite: bool = False) -> None:
        """Open `folder`, made if missing.

        More episodes of the same configuration go on with those that are there.

        Raises:
            OutputError: the folder cannot be written, holds other files, or holds results of another configuration.
        """
        self.folder = folder
        self._config = json.loads(json.dumps(config))
        self._results: dict[int, EpisodeResult] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if overwrite:
                self._remove_own_files()
            self._open(strangers_allowed=overwrite)
        except OutputError:
            raise
        except OSError as error:
            is_file = isinstance(error, FileExistsError | NotADirectoryError)
            reason = "a file is in the way" if is_file else error.strerror or str(error)
            raise OutputError(
                f"results cannot be written to {folder}: {reason}. Choose a folder that you may write with --out"
            ) from error

    def _open(self, *, strangers_allowed: bool) -> None:
        config_file = self.folder / CONFIG_FILE
        if not config_file.exists():
            strangers = sorted(f.name for f in self.folder.iterdir())
            if strangers and not strangers_allowed:
                raise OutputError(
                    f"{self.folder} must be empty or hold results of simpick, it holds {', '.join(strangers[:5])}. "
                    "Choose another folder with --out"
                )
            atomic_write_text(config_file, json.dumps(self._config, indent=2) + "\n")
            return
        previous = _read_config(config_file)
        differing = sorted(k for k in previous.keys() | self._config.keys() if previous.get(k) != self._config.get(k))
        if differing == ["episodes"] and previous.get("episodes", 0) < self._config.get("episodes", 0):
            atomic_write_text(config_file, json.dumps(self._config, indent=2) + "\n")
            differing = []
        if differing:
            changes = ", ".join(f"{k} ({previous.get(k)!r} there, {self._config.get(k)!r} now)" for k in differing)
            raise OutputError(
                f"{self.folder} holds results of another configuration: {changes}. "
                "Choose another folder with --out, or --overwrite to replace them"
            )
        results_file = self.folder / RESULTS_FILE
        if results_file.exists():
            for result in read_results(results_file):
                self._results[result.episode] = result

    def _remove_own_files(self) -> None:
        for pattern in (CONFIG_FILE, RESULTS_FILE, "*.rrd", "*.rrd.partial"):
            for file in self.folder.glob(pattern):
                file.unlink()

    @property
    def results(self) -> tuple[EpisodeResult, ...]:
        """Return the finished episodes in order."""
        return tuple(self._results[k] for k in sorted(self._results))

    def __contains__(self, episode: int) -> bool:
        return episode in self._results

    def add(self, result: EpisodeResult) -> None:
        """Keep a finished episode, on disk before this returns."""
        self._results[result.episode] = result
        lines = [json.dumps(r.to_json()) + "\n" for r in self.results]
        atomic_write_text(self.folder / RESULTS_FILE, "".join(lines))


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
