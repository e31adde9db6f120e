"""``simpick soak``: many episodes in one process, with a verdict on its memory, descriptors and threads."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from simpick.config import Config, PositiveFloat
from simpick.experiments.config import RunConfig


@dataclass(frozen=True)
class Soak(Config):
    """Run many episodes in one process and judge what it holds.

    After each episode the process's memory, file descriptors, threads and processor time are noted; an episode that
    raises counts as a fault, and the next one follows. The exit code is 0 where all stay bounded, or where the episodes
    are too few for a verdict, and 1 where one grows or an episode failed. Linux only.
    """

    config: tyro.conf.OmitArgPrefixes[RunConfig] = field(default_factory=lambda: RunConfig(episodes=100, count=4))
    """What to run."""
    out: Path = Path("logs/soak")
    """Folder for soak.json and soak.png."""
    minutes: Annotated[
        PositiveFloat | None, tyro.conf.arg(metavar="FLOAT", help_behavior_hint="(default: no limit)")
    ] = None
    """Begin no episode after this time."""
    record: bool = False
    """Write one rerun recording per episode too."""
    overwrite: bool = False
    """Replace the files of an earlier soak in the folder --out."""

    def run(self) -> int:
        """Run the episodes, and print the figures and the verdict."""
        from simpick.cli.outputs import counted
        from simpick.terminal import Console, progress_bar

        console = Console()
        console.print_line(
            f"soaking: {counted(self.config.episodes, 'bin')} with {self.config.mode} in one process: {self.out}"
        )
        from simpick.experiments.episodes import validate
        from simpick.experiments.soak import PLOT_FILE, RESULT_FILE, EpisodeSample, draw_soak, judge_soak, soak
        from simpick.records import PickRecord
        from simpick.run_folder import RunFolder

        validate(self.config)
        results = (RESULT_FILE, PLOT_FILE, "*.rrd")
        folder = RunFolder(self.out, None, config_file=RESULT_FILE, results=results, overwrite=self.overwrite)
        with progress_bar(console, keep=True) as progress:
            task = progress.add_task("filling the first bin, loading estimators", total=self.config.episodes)

            def show_pick(episode: int, pick: PickRecord) -> None:
                where = f"bin {episode}, pick {pick.pick}"
                progress.update(task, description=f"{where}: {pick.outcome.value}, {pick.remaining} left")

            def show_episode(sample: EpisodeSample) -> None:
                held = f"{sample.memory_mib:.0f} MiB, {sample.descriptors} descriptors, {sample.threads} threads"
                progress.update(task, advance=1, description=f"bin {sample.episode}: {held}")

            samples = soak(
                self.config,
                folder,
                minutes=self.minutes,
                record=self.record,
                on_pick=show_pick,
                on_episode=show_episode,
            )
        verdict = judge_soak(samples)
        draw_soak(samples, verdict, self.out / PLOT_FILE)
        for reason in verdict.reasons:
            console.print_line(reason)
        console.print_line(f"verdict after {counted(len(samples), 'episode')}: {verdict.state}")
        console.print_line(f"figures: {self.out / RESULT_FILE}, plot: {self.out / PLOT_FILE}")
        return 1 if verdict.state == "failed" else 0
