"""Many episodes in one process: whether memory, file descriptors and threads stay bounded, and what failed."""

from __future__ import annotations

import json
import os
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Literal

from simpick.errors import ConfigError
from simpick.experiments.config import RunConfig
from simpick.experiments.episodes import run_recorded_episode
from simpick.plotting import new_figure, save_figure
from simpick.records import PickOutcome, PickRecord
from simpick.run_folder import RunFolder

RESULT_FILE = "soak.json"
PLOT_FILE = "soak.png"
MEMORY_GROWTH = 0.2
"""Of resident memory, from the first episodes after the warm-up to the last: more counts as a leak."""
FEWEST_EPISODES = 20
"""Below this number there is no verdict."""
_PROC = Path("/proc/self")


@dataclass(frozen=True)
class EpisodeSample:
    """What one episode did, and what the process held after it."""

    episode: int
    memory_mib: float
    """Resident memory."""
    descriptors: int
    """Open file descriptors."""
    threads: int
    wall_s: float
    """Of this episode."""
    cpu_s: float
    """Of this episode, all threads."""
    picks: int
    delivered: int
    fault: str = ""
    """What failed: the cause of a simulation fault, or the traceback of an exception."""


@dataclass(frozen=True)
class SoakVerdict:
    """Whether the process may run on."""

    state: Literal["steady", "failed", "undecided"]
    reasons: tuple[str, ...]
    """One sentence per finding."""


def soak(
    config: RunConfig,
    folder: RunFolder,
    *,
    minutes: float | None = None,
    record: bool = False,
    on_pick: Callable[[int, PickRecord], None] | None = None,
    on_episode: Callable[[EpisodeSample], None] | None = None,
) -> list[EpisodeSample]:
    """Run the episodes of `config` in this process, and write a sample of each to ``soak.json`` in `folder`.

    An episode that raises is a fault, and the next one follows. No episode begins after `minutes`. With `record`, each
    is recorded into the folder.

    Raises:
        ConfigError: the operating system has no ``/proc``, from which the figures are read.
        OutputError: the disk is full.
    """
    if not (_PROC / "fd").is_dir():
        raise ConfigError("soak needs the folder /proc/self, which this system does not have; run it on Linux")
    samples: list[EpisodeSample] = []
    end_s = time.monotonic() + (float("inf") if minutes is None else 60 * minutes)
    for episode in range(config.episodes):
        if time.monotonic() > end_s:
            break
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        picks: list[PickRecord] = []

        def count(pick: PickRecord, episode: int = episode, picks: list[PickRecord] = picks) -> None:
            picks.append(pick)
            if on_pick is not None:
                on_pick(episode, pick)

        fault = ""
        try:
            result = run_recorded_episode(config, episode, folder.path if record else None, on_pick=count)
            if result.ended == PickOutcome.SIMULATION_FAULT:
                fault = result.picks[-1].cause
        except Exception:
            fault = traceback.format_exc()
        samples.append(
            EpisodeSample(
                episode,
                *_held(),
                time.perf_counter() - wall_s,
                time.process_time() - cpu_s,
                len(picks),
                sum(len(pick.delivered) for pick in picks),
                fault,
            )
        )
        folder.write(RESULT_FILE, _as_json(config, samples))
        if on_episode is not None:
            on_episode(samples[-1])
    return samples


def judge_soak(samples: Sequence[EpisodeSample]) -> SoakVerdict:
    """Return whether memory, descriptors and threads stay bounded and nothing failed.

    The first fifth of the episodes is warm-up: parts are loaded, caches filled. Of the rest, the medians of the first
    and of the last fifth are compared.
    """
    faults = [sample for sample in samples if sample.fault]
    reasons = []
    if faults:
        last_lines = dict.fromkeys(sample.fault.strip().splitlines()[-1] for sample in faults)
        reasons.append(f"{len(faults)} of {len(samples)} episodes failed: {'; '.join(list(last_lines)[:3])}")
    if len(samples) < FEWEST_EPISODES:
        reasons.append(f"growth needs {FEWEST_EPISODES} episodes or more, got {len(samples)}")
        return SoakVerdict("failed" if faults else "undecided", tuple(reasons))
    fifth = len(samples) // 5
    first, last = samples[fifth : 2 * fifth], samples[-fifth:]

    def medians(field: str) -> tuple[float, float]:
        return tuple(median(getattr(sample, field) for sample in part) for part in (first, last))  # type: ignore[return-value]

    memory = medians("memory_mib")
    grows = memory[1] > (1 + MEMORY_GROWTH) * memory[0]
    change = f"{memory[0]:.0f} to {memory[1]:.0f} MiB ({memory[1] / memory[0] - 1:+.1%})"
    reasons.append(f"resident memory {'grows' if grows else 'stays'}: {change}")
    for field, name in (("descriptors", "file descriptors"), ("threads", "threads")):
        before, after = medians(field)
        grows |= after > before
        reasons.append(f"{name} {'grow' if after > before else 'stay'}: {before:g} to {after:g}")
    return SoakVerdict("failed" if grows or faults else "steady", tuple(reasons))


def draw_soak(samples: Sequence[EpisodeSample], verdict: SoakVerdict, file: Path) -> None:
    """Plot what the process held after each episode; episodes that failed are marked.

    Raises:
        OutputError: the file cannot be written.
    """
    figure = new_figure(8, 7)
    axes = figure.subplots(4, 1, sharex=True)
    episodes = [sample.episode + 1 for sample in samples]
    rows = {"memory_mib": "memory [MiB]", "descriptors": "file descriptors", "threads": "threads", "cpu_s": "CPU [s]"}
    for axis, (field, label) in zip(axes, rows.items(), strict=True):
        values = [getattr(sample, field) for sample in samples]
        axis.plot(episodes, values, "-", color="#0072b2", linewidth=1.2)
        failed = [(x, y) for x, y, sample in zip(episodes, values, samples, strict=True) if sample.fault]
        if failed:
            axis.plot(*zip(*failed, strict=True), "x", color="#d55e00", label="fault")
            axis.legend()
        axis.set_ylabel(label)
        axis.set_ylim(0, 1.15 * max([1, *values]))
        axis.grid(alpha=0.25)
    axes[0].set_title(f"{len(samples)} episodes in one process: {verdict.state}")
    axes[-1].set_xlabel("episode")
    save_figure(figure, file)


def _held() -> tuple[float, int, int]:
    """Return this process's resident memory in MiB, its open descriptors and its threads."""
    pages = int((_PROC / "statm").read_text().split()[1])
    # The folder itself is open while it is listed.
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20, len(list((_PROC / "fd").iterdir())) - 1, _threads()


def _threads() -> int:
    return len(list((_PROC / "task").iterdir()))


def _as_json(config: RunConfig, samples: Sequence[EpisodeSample]) -> str:
    verdict = judge_soak(samples)
    content = {"config": config.to_json(), "verdict": asdict(verdict), "episodes": [asdict(s) for s in samples]}
    return json.dumps(content, indent=1) + "\n"
