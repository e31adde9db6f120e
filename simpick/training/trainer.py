"""`train`: the training loop, with a time budget, exact resume, and any number of processes under torchrun."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from simpick.errors import ConfigError
from simpick.estimators.raypose.checkpoints import load_checkpoint, save_checkpoint
from simpick.estimators.raypose.diffusion.schedule import Schedule, make_schedule
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.encoders.dino_encoder import load_dino_weights
from simpick.estimators.raypose.network.losses import weighted_sum
from simpick.estimators.raypose.network.model import RayPose
from simpick.training.budget import Budget
from simpick.training.config import TrainConfig
from simpick.training.data.batch_source import BatchSource
from simpick.training.data.batches import TrainingBatch
from simpick.training.distributed import Distributed
from simpick.training.graceful_stop import GracefulStop
from simpick.training.moving_average import moving_average
from simpick.training.resources import Resources
from simpick.training.run_folder import TrainingFolder
from simpick.training.state import TrainingState
from simpick.training.training_step import loss_terms, matching_terms
from simpick.training.validation import Validation

LOG_STEPS = 20
"""Steps between two rows of the log."""


def train(
    network: RayPoseConfig,
    config: TrainConfig,
    budget: Budget,
    folder: Path,
    *,
    resources: Resources | None = None,
    start_from: Path | None = None,
    dino_weights: Path | None = None,
    on_row: Callable[[dict[str, Any], float], None] | None = None,
) -> Path:
    """Train a network until the budget is spent and return the file of its weights.

    A folder with a run of the same configuration is resumed: weights, their average, optimiser and step, which
    determines all randomness and the order of the data. `start_from` is a file of initial weights instead of random
    ones, `dino_weights` the file of a frozen DINOv2. `on_row` is called with each row of the log and the finished share
    of the run.

    Raises:
        OutputError: the folder holds another run, or cannot be written.
        ConfigError: a frozen image encoder has no weights, or there are more templates in training than the network
            takes.
        SimpickError: data cannot be made, or the loss is no longer a number.
        KeyboardInterrupt: Ctrl-C or SIGTERM; the current step was finished and the state saved.
    """
    if config.templates > network.templates:
        raise ConfigError(f"templates must be at most the network's {network.templates}, got {config.templates}")
    resources = resources or Resources()
    processes = Distributed.from_environment(resources.device)
    if resources.threads:
        torch.set_num_threads(resources.threads)
    run = TrainingFolder(folder, {"network": network.to_json(), "training": config.to_json()}, processes.rank)
    state = _start(network, config, processes.device, start_from, dino_weights)
    if saved := run.load_state():
        run.restore(state, saved)
    trainer = _Trainer(config, budget, resources, processes, run, state, on_row or (lambda row, progress: None))
    with processes:
        trainer.run()
    return run.weights


def _start(
    network: RayPoseConfig,
    config: TrainConfig,
    device: torch.device,
    start_from: Path | None,
    dino_weights: Path | None,
) -> TrainingState[RayPose]:
    if network.is_dino != (dino_weights is not None):
        raise ConfigError(
            f"image encoder {network.image_encoder!r} is frozen: give a local file with its weights as dino_weights"
            if network.is_dino
            else "dino_weights are for DINOv2 as image encoder (size 'paper'), simpick's own is trained"
        )
    # Initial weights follow from the seed; the caller's random state is left as it was.
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        model = RayPose(network)
    if dino_weights is not None:
        load_dino_weights(model.image_encoder, dino_weights)
    if start_from is not None:
        begun = load_checkpoint(start_from, dino_weights=dino_weights).model
        try:
            model.load_state_dict(begun.state_dict())
        except RuntimeError as error:
            raise ConfigError(f"{start_from} must hold weights of this network's size; it does not: {error}") from error
    model = model.to(device).to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    trained = [p for p in model.parameters() if p.requires_grad]
    optimizer = torch.optim.AdamW(trained, lr=config.learning_rate, betas=(0.9, 0.98), weight_decay=config.weight_decay)
    return TrainingState(model.train(), moving_average(model, config.ema_decay), optimizer)


@dataclass
class _Trainer:
    """The loop over steps, validations and rows of the log."""

    config: TrainConfig
    budget: Budget
    resources: Resources
    processes: Distributed
    run_folder: TrainingFolder
    state: TrainingState[RayPose]
    on_row: Callable[[dict[str, Any], float], None]
    sums: dict[str, float] = field(default_factory=dict)
    """Sum of each term of the loss over the steps since the last row."""
    counted: int = 0
    """Steps since the last row."""

    @cached_property
    def schedule(self) -> Schedule:
        """Return the noise schedule."""
        return make_schedule(self.config.schedule)

    def run(self) -> None:
        """Train until the budget is spent."""
        if self._progress() >= 1:
            # A run that was stopped before its first validation, and has a smaller budget now, has no weights yet.
            if self.processes.is_first and not self.run_folder.weights.exists():
                self._validate(self._validation())
            return
        with BatchSource(
            self.config, self.state.model.config, self._shards(), self.resources, self.processes, self.state.step
        ) as source:
            validation = self._validation() if self.processes.is_first else None
            self.processes.wait()
            with GracefulStop() as graceful_stop:
                self._loop(source, validation, graceful_stop)

    def _loop(self, source: BatchSource, validation: Validation | None, graceful_stop: GracefulStop) -> None:
        last = time.perf_counter()
        validated_s = self.state.seconds
        while True:
            self._step(source.get(self.state.step))
            now = time.perf_counter()
            taken_s, stop = self.processes.agree(now - last, float(graceful_stop.requested))
            self.state.seconds += taken_s
            last = now
            ended = self._progress() >= 1
            if self.state.step % LOG_STEPS == 0 or ended:
                self._log(source)
            if ended or self.state.seconds - validated_s >= self.resources.validate_every_s:
                validated_s = self.state.seconds
                if validation is not None:
                    self._validate(validation)
                # The time of validation does not count, neither in this process nor in those that wait.
                self.processes.wait()
                last = time.perf_counter()
            if ended:
                return
            if stop:
                if self.processes.is_first:
                    self.run_folder.save_state(self.state.save())
                raise KeyboardInterrupt

    def _step(self, batch: TrainingBatch) -> None:
        config, state, device = self.config, self.state, self.processes.device
        rate = config.learning_rate_at(state.step, min(1.0, self._progress()))
        for group in state.optimizer.param_groups:
            group["lr"] = rate
        seed = np.random.SeedSequence([config.seed, 9, self.processes.rank, state.step]).generate_state(1, np.uint64)
        generator = torch.Generator().manual_seed(int(seed[0]) >> 1)
        with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
            if self._is_matching_only():
                terms = matching_terms(state.model, batch.to(device))
            else:
                terms = loss_terms(state.model, batch.to(device), self.schedule, generator)
        loss = weighted_sum(terms, config.losses)
        state.descend(loss, config.max_grad_norm, self.processes.average_gradients)
        for name, value in {**terms, "loss": loss}.items():
            self.sums[name] = self.sums.get(name, 0.0) + float(value.detach())
        self.counted += 1

    def _is_matching_only(self) -> bool:
        network = self.state.model.config
        return network.matching and network.template_pose and self._progress() < self.config.matching_share

    def _log(self, source: BatchSource) -> None:
        means = {name: value / self.counted for name, value in self.sums.items()}
        self.sums, self.counted = {}, 0
        rate = self.state.step * self.config.batch * self.processes.count / max(self.state.seconds, 1e-9)
        self._row("train", {**means, "queries_per_s": rate, "waiting_share": source.waiting_share()})

    def _validation(self) -> Validation:
        return Validation.held_out(self._shards(), self.state.model.config, self.config)

    def _shards(self) -> Path:
        return self.resources.shards or self.run_folder.shards

    def _validate(self, validation: Validation) -> None:
        average = self.state.averaged_model
        figures = validation.measure(average, self.schedule)
        self._row("validation", figures)
        card = {"training": self.config.to_json(), "validation": figures}
        card |= {"steps": self.state.step, "queries": self._queries(), "hours": self.state.seconds / 3600}
        save_checkpoint(self.run_folder.weights, average, card)
        self.run_folder.save_state(self.state.save())

    def _row(self, split: str, figures: dict[str, float]) -> None:
        if self.processes.is_first:
            row = {"step": self.state.step, "queries": self._queries(), "seconds": round(self.state.seconds, 1)}
            row |= {"split": split, **figures}
            self.run_folder.log(row)
            self.on_row(row, min(1.0, self._progress()))

    def _queries(self) -> int:
        return self.state.step * self.config.batch * self.processes.count

    def _progress(self) -> float:
        return self.budget.progress(self.state.step, self.state.seconds)
