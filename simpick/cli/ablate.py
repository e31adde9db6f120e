"""``simpick ablate``: train the paper's ablations, or one network with each noise schedule, and print the tables."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from simpick.training.resources import Resources


@dataclass(frozen=True)
class Ablate:
    """Train variants of RayPose and compare their poses.

    Every variant has the same budget; poses are those of held-out parts.

    paper: with and without each component, and with other templates in training (tables 2 and 3 of the paper).
    schedules: noise schedules, each sampled with 1, 3, 5 and 10 steps. A command that was stopped goes on where it was.
    """

    what: tyro.conf.Positional[Literal["paper", "schedules"]]
    """Which comparison."""
    size: Literal["tiny", "small", "base", "paper"] = "tiny"
    """How large the networks are."""
    minutes: float | None = None
    """Train each so long."""
    steps: int | None = None
    """Train each so many steps."""
    out: Path = Path("logs/ablations")
    """Folder for runs, data and tables."""
    config: Path | None = None
    """JSON file with settings of training and data, as for `simpick train`."""
    resources: tyro.conf.OmitArgPrefixes[Resources] = field(default_factory=Resources)
    """What to use of this machine."""

    def run(self) -> int:
        """Train and measure every variant, print and write the tables."""
        from rich.console import Console
        from rich.markdown import Markdown

        from simpick.estimators.raypose.network.config import preset
        from simpick.training import ablations
        from simpick.training.config import TrainConfig, read_train_config
        from simpick.training.curves import plot_scaling, read_log
        from simpick.training.progress import TrainProgress
        from simpick.training.run_folder import TrainingFolder
        from simpick.training.trainer import Budget

        budget = Budget(self.minutes, self.steps)
        training = read_train_config(self.config) if self.config else TrainConfig()
        ablation = ablations.Ablation(preset(self.size), training, budget, self.out, self.resources)
        is_paper = self.what == "paper"
        variants = list(dict.fromkeys(v.name for v in ablations.COMPONENTS + ablations.TEMPLATES))
        by_name = {v.name: v for v in ablations.COMPONENTS + ablations.TEMPLATES + ablations.SCHEDULE_VARIANTS}
        names = variants if is_paper else [v.name for v in ablations.SCHEDULE_VARIANTS]
        console = Console()
        results = [ablations.measure_untrained(ablation)] if is_paper else []
        for name in names:
            variant = by_name[name]
            console.print(f"{variant.label}: {self.out / name}", soft_wrap=True)
            with TrainProgress(budget, console) as progress:
                ablation.run(variant, progress.show)
            if is_paper:
                results.append(ablations.measure(ablation, variant))
            else:
                results += ablations.measure_steps(ablation, variant)
        text = ablations.tables(results) if is_paper else ablations.schedule_table(results)
        console.print(Markdown(text))
        files = ablations.write_results(self.out, self.what, results, text)
        plot = self.out / f"{self.what}.png"
        plot_scaling({by_name[name].label: read_log(self.out / name / TrainingFolder.LOG) for name in names}, plot)
        for file in [*files, plot]:
            console.print(f"written: {file}", soft_wrap=True)
        return 0
