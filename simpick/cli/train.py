"""``simpick train``: train a coarse or a fine RayPose predictor on random parts, in as much time as there is."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from simpick.training.resources import Resources

if TYPE_CHECKING:
    from simpick.estimators.raypose.network.config import RayPoseConfig
    from simpick.training.config import TrainConfig

_TRAINING = ("batch", "parts", "templates", "learning_rate", "schedule", "validation_shards", "validation_queries")


@dataclass(frozen=True)
class Train:
    """Train RayPose on random parts in random bins.

    Data are rendered while it trains; library parts are never seen.

    Ctrl-C keeps what was learned: the same command goes on where it stopped, and one with more time goes on longer.
    The folder then holds weights.safetensors, log.jsonl, curves.png, scaling.png and curves.rrd.

    On several GPUs, each with renderers of its own; the batch is that of one process:

        torchrun --nproc_per_node 2 -m simpick.cli.main train fine --size base --minutes 600 --renderers 7
    """

    mode: tyro.conf.Positional[Literal["coarse", "fine"]]
    """coarse: templates over the whole sphere; fine: templates around a pose that is roughly known."""
    size: Literal["tiny", "small", "base", "paper"] = "small"
    """How large the network is; tiny is for tests, base and paper want a GPU."""
    minutes: float | None = None
    """Train so long in all, resumptions included."""
    steps: int | None = None
    """Train so many steps in all, resumptions included."""
    out: Path | None = None
    """The run's folder; logs/train/<mode>-<size> if none is given."""
    start_from: Path | None = None
    """Weights to begin with, of the same size: for example coarse ones for a fine predictor."""
    dino_weights: Path | None = None
    """Size paper only: local file with DINOv2's weights, safetensors or .pth; they are never downloaded."""
    config: Path | None = None
    """JSON file with settings of training, data and augmentation: a run's config.json, or parts of one. The options
    here go before it."""
    seed: int | None = None
    """Of weights, noise, parts and bins."""
    batch: int | None = None
    """Queries a step, on each process (32)."""
    parts: int | None = None
    """Parts that the queries of a step are of (4); divides the batch."""
    templates: int | None = None
    """Templates a query in training (4); 8 are used at run time."""
    learning_rate: float | None = None
    """Of AdamW, after the warm-up and before it falls (0.001)."""
    schedule: Literal["log_snr", "cosine", "linear"] | None = None
    """Noise schedule (log_snr)."""
    validation_shards: int | None = None
    """Held-out parts (10)."""
    validation_queries: int | None = None
    """Queries of each (8)."""
    resources: tyro.conf.OmitArgPrefixes[Resources] = field(default_factory=Resources)
    """What to use of this machine."""
    relative_pose: bool = True
    """Predict poses relative to templates."""
    multiview: bool = True
    """Let templates see one another."""
    template_pose: bool = True
    """Tell the network the templates' poses."""
    matching: bool = True
    """Match descriptors, where the size does (paper does not)."""
    flow: bool = True
    """Correct the matched pose by flow, where the size and the other switches let it."""
    template_views: Literal["random", "fixed"] = "random"
    """Whether coarse templates are drawn anew for every query."""
    spread_deg: float | None = None
    """Angle within which a fine predictor's templates lie (30); coarse has 180."""
    spread_m: float | None = None
    """Distance within which they lie (0.05)."""

    def run(self) -> int:
        """Train, showing progress, and draw the curves."""
        from contextlib import nullcontext

        from rich.console import Console

        from simpick.training.curves import write_curves
        from simpick.training.distributed import Distributed
        from simpick.training.progress import TrainProgress
        from simpick.training.run_folder import TrainingFolder
        from simpick.training.trainer import Budget, train

        network, config, budget = self.network(), self.training(), Budget(self.minutes, self.steps)
        folder = self.out or Path("logs/train") / f"{self.mode}-{self.size}"
        is_first = Distributed.from_environment(self.resources.device).is_first
        console = Console(quiet=not is_first)
        console.print(f"training {self.mode} ({self.size}) in {folder}", soft_wrap=True)
        progress = TrainProgress(budget, console)
        try:
            with progress if is_first else nullcontext():
                weights = train(
                    network,
                    config,
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
                console.print(f"written: {file}", soft_wrap=True)
        return 0

    def network(self) -> RayPoseConfig:
        """Return the network's configuration; raises ConfigError."""
        import dataclasses

        from simpick.errors import ConfigError
        from simpick.estimators.raypose.network.config import preset

        if self.mode == "coarse" and not (self.spread_deg is None and self.spread_m is None):
            raise ConfigError(
                "a coarse predictor's templates are spread over the whole sphere; --spread-... is for fine"
            )
        if self.mode == "fine" and self.spread_deg == 180:
            raise ConfigError("spread_deg of a fine predictor must be below 180; train coarse instead")
        base = preset(self.size)
        return dataclasses.replace(
            base,
            relative_pose=self.relative_pose,
            multiview=self.multiview,
            template_pose=self.template_pose,
            matching=base.matching and self.matching,
            flow=base.flow and self.flow and self.matching and self.template_pose,
            template_views=self.template_views,
            spread_deg=180.0 if self.mode == "coarse" else _or(self.spread_deg, base.spread_deg),
            spread_m=_or(self.spread_m, base.spread_m),
        )

    def training(self) -> TrainConfig:
        """Return the training's configuration; raises ConfigError."""
        import dataclasses

        from simpick.training.config import TrainConfig, read_train_config

        config = read_train_config(self.config) if self.config else TrainConfig()
        given = {name: getattr(self, name) for name in _TRAINING if getattr(self, name) is not None}
        if self.seed is not None:
            given |= {"seed": self.seed, "data": dataclasses.replace(config.data, seed=self.seed)}
        return dataclasses.replace(config, **given)


def _or(value: float | None, default: float) -> float:
    return default if value is None else value
