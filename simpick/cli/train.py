"""``simpick train``: train a coarse or a fine RayPose predictor on random parts within a time budget."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import tyro

from simpick.cli.training_options import TrainingOptions
from simpick.errors import ConfigError
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.training.data.augmentation import AugmentationConfig

_SWITCHES = {
    field.name
    for config in (RayPoseConfig, AugmentationConfig)
    for field in fields(config)
    if isinstance(field.default, bool)
}
"""Options without a value: ``--network.flow``, ``--network.no-flow``."""


@dataclass(frozen=True)
class Train(TrainingOptions):
    """Train RayPose on random parts in random bins.

    Data are rendered during training; library parts are never used.

    Ctrl-C saves the state: the same command resumes, also with more time. The folder then holds weights.safetensors,
    log.jsonl, curves.png, scaling.png and curves.rrd.

    On several GPUs, each with its own renderers; --training.batch is that of one process:

        torchrun --nproc_per_node 2 -m simpick.cli.main train fine --minutes 600
    """

    mode: tyro.conf.Positional[Literal["coarse", "fine"]] = "fine"
    """coarse: templates over the whole sphere; fine: templates around an approximate pose."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="(default: logs/train/MODE-SIZE)")] = (
        None
    )
    """Folder of the run."""
    start_from: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: random)")] = None
    """Initial weights, of the same size: for example coarse ones for a fine predictor."""
    dino_weights: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none)")] = None
    """Size paper: local file with DINOv2's weights, safetensors or .pth; they are never downloaded."""

    @classmethod
    def defaults(cls, arguments: Sequence[str]) -> Train:
        """Return the options' defaults: a coarse predictor's templates are spread over the whole sphere."""
        options = super().defaults(arguments)
        if not any(a == "coarse" and not _takes_value(before) for before, a in pairwise(["", *arguments])):
            return options
        return replace(options, network=replace(options.network, spread_deg=180.0))

    def run(self) -> int:
        """Train, showing progress, and draw the curves."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        folder = self.out or Path("logs/train") / f"{self.mode}-{self.size}"
        console = Console(quiet=int(os.environ.get("RANK", "0")) > 0)
        console.print_line(f"training {self.mode} ({self.size}) in {folder}")
        from contextlib import nullcontext

        from simpick.training.budget import Budget
        from simpick.training.curves import write_curves
        from simpick.training.distributed import Distributed
        from simpick.training.progress import TrainProgress
        from simpick.training.run_folder import TrainingFolder
        from simpick.training.trainer import train

        if self.network.is_fine != (self.mode == "fine"):
            raise ConfigError(
                "network.spread_deg must be below 180 for fine and 180 for coarse, whose templates are spread over the "
                f"sphere; got {self.network.spread_deg:g} for {self.mode}"
            )
        budget = Budget(self.minutes, self.steps)
        is_first = Distributed.from_environment(self.resources.device).is_first
        progress = TrainProgress(console)
        try:
            with progress if is_first else nullcontext():
                weights = train(
                    self.network,
                    self.training,
                    budget,
                    folder,
                    resources=self.resources,
                    start_from=self.start_from,
                    dino_weights=self.dino_weights,
                    on_row=progress.show,
                )
        except KeyboardInterrupt:
            if is_first:
                raise
            return 130
        if is_first:
            log = folder / TrainingFolder.LOG
            for file in [weights, *write_curves(log, recording_id=f"training-{folder.name}")]:
                console.print_line(f"written: {file}")
        return 0


def _takes_value(argument: str) -> bool:
    """Return whether the next argument is this one's value: not after ``--name=value``, nor after a switch."""
    name = argument.rpartition(".")[2].removeprefix("no-").replace("-", "_")
    return argument.startswith("--") and "=" not in argument and name not in _SWITCHES
