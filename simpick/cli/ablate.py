"""``simpick ablate``: train the paper's ablations, or one network per noise schedule, and print the tables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from simpick.cli.training_options import TrainingOptions


@dataclass(frozen=True)
class Ablate(TrainingOptions):
    """Train and compare variants of RayPose with equal budgets.

    paper: with and without each component, and with other templates in training (tables 2 and 3 of the paper).

    schedules: noise schedules, each sampled with 1, 3, 5 and 10 steps.

    The same command resumes a comparison that was stopped. Poses are those of held-out random parts.
    """

    what: tyro.conf.Positional[Literal["paper", "schedules"]] = "paper"
    """Which comparison."""
    size: Literal["tiny", "small", "base", "paper"] = "tiny"
    """Preset of the options --network.*: tiny is for tests, base and paper need a GPU."""
    out: Path = Path("logs/ablations")
    """Folder for runs, data and tables."""

    def run(self) -> int:
        """Train and measure every variant, print and write the tables."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(f"training and comparing variants of RayPose ({self.what}): {self.out}")
        from simpick.terminal import Markdown
        from simpick.training import ablations
        from simpick.training.budget import Budget
        from simpick.training.curves import plot_scaling, read_log
        from simpick.training.progress import TrainProgress
        from simpick.training.run_folder import TrainingFolder

        budget = Budget(self.minutes, self.steps)
        ablation = ablations.Ablation(self.network, self.training, budget, self.out, self.resources)
        is_paper = self.what == "paper"
        variants = list(dict.fromkeys(v.name for v in ablations.COMPONENTS + ablations.TEMPLATES))
        by_name = {v.name: v for v in ablations.COMPONENTS + ablations.TEMPLATES + ablations.SCHEDULE_VARIANTS}
        names = variants if is_paper else [v.name for v in ablations.SCHEDULE_VARIANTS]
        results = [ablations.measure_untrained(ablation)] if is_paper else []
        for name in names:
            variant = by_name[name]
            console.print_line(f"{variant.label}: {self.out / name}")
            with TrainProgress(console) as progress:
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
            console.print_line(f"written: {file}")
        return 0
