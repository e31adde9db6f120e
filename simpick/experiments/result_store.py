"""``results.jsonl``: one line per episode, complete after every episode, resumable after a kill."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simpick.config import from_json
from simpick.core_time import CoreTime
from simpick.errors import OutputError
from simpick.experiments.provenance_changes import changes
from simpick.json_text import is_json, load_json
from simpick.records import PickOutcome, PickRecord
from simpick.run_folder import CONFIG_FILE, RunFolder

RESULTS_FILE = "results.jsonl"


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
    """Wall-clock seconds of the whole episode (``wall``) and of making the scene (``reset``); and the `CoreTime` of its
    process: ``threads_run`` and ``threads_wait``."""
    mode: str = ""
    """Full name of the perception mode that picked, such as ``retrieval@8``; see `RunConfig.mode`."""

    @property
    def key(self) -> tuple[int, str]:
        """Return what identifies this result in its folder: bin and perception mode."""
        return self.episode, self.mode

    @property
    def core_time(self) -> CoreTime:
        """Return how long the threads of the episode's process ran and waited for a core."""
        return CoreTime(self.timings_s.get("threads_run", 0.0), self.timings_s.get("threads_wait", 0.0))

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


class ResultStore(RunFolder):
    """The folder of a run or a comparison, with its finished episodes.

    ``results.jsonl`` holds them in order and is replaced as a whole after each, so that a kill at any moment loses no
    finished episode.
    """

    def __init__(
        self, path: Path, provenance: dict[str, Any], *, overwrite: bool = False, config_file: str = CONFIG_FILE
    ) -> None:
        """Open the folder, made if missing, and read the episodes in it.

        More ``episodes`` or more ``modes`` of the same configuration are added to those that are there.

        Raises:
            OutputError: see `RunFolder`; or a line of ``results.jsonl`` is not an episode.
        """
        results = (RESULTS_FILE, "*.rrd", "*.rrd.partial", "*.rrd.room")
        super().__init__(
            path, provenance, config_file=config_file, results=results, changes=changes, overwrite=overwrite
        )
        file = path / RESULTS_FILE
        found = read_results(file) if file.exists() and not overwrite else []
        self._results = {result.key: result for result in found}

    @property
    def results(self) -> tuple[EpisodeResult, ...]:
        """Return the finished episodes in order, those of one bin by the name of their mode."""
        return tuple(self._results[key] for key in sorted(self._results))

    def __contains__(self, key: tuple[int, str]) -> bool:
        return key in self._results

    def add(self, result: EpisodeResult) -> None:
        """Keep a finished episode, on disk before this returns.

        Raises:
            OutputError: the disk is full or gone; what was kept before stays.
        """
        results = self._results | {result.key: result}
        self.write(RESULTS_FILE, "".join(json.dumps(results[key].to_json()) + "\n" for key in sorted(results)))
        self._results = results


def read_results(file: Path) -> list[EpisodeResult]:
    """Return the episodes in a ``results.jsonl``; a last line that was cut off is left out.

    Raises:
        OutputError: the file cannot be read, or a line is not an episode; the message names it.
    """
    try:
        *lines, cut_off = file.read_bytes().split(b"\n")
    except OSError as error:
        raise OutputError(f"{file} cannot be read: {error.strerror or error}. Make it readable") from error
    results = []
    for number, line in enumerate([*lines, cut_off] if is_json(cut_off) else lines, start=1):
        try:
            # Lines of versions without modes are refused: their mode cannot be known.
            results.append(from_json(EpisodeResult, load_json(line), complete=True))
        except ValueError as error:
            raise OutputError(
                f"{file}, line {number}, is not an episode of this version of simpick ({error}). "
                "Remove that line to run its episode again, or use --overwrite"
            ) from error
    return results
