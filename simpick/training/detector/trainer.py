"""`train_detector`: the training loop, with a time budget and exact resume."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from simpick.estimators.detector.checkpoints import load_detector_checkpoint, save_detector_checkpoint
from simpick.estimators.detector.encoder import load_imagenet_weights
from simpick.estimators.detector.network import InstanceNetwork
from simpick.training.budget import Budget
from simpick.training.detector.batches import CropBatch, crop_batches
from simpick.training.detector.bin_supply import BinSupply
from simpick.training.detector.config import DetectorTrainConfig
from simpick.training.detector.device_batches import device_batches
from simpick.training.detector.device_views import DeviceViews, do_views_fit
from simpick.training.detector.losses import loss_terms, weighted_sum
from simpick.training.detector.resources import DetectorResources
from simpick.training.detector.validation import DetectorValidation
from simpick.training.graceful_stop import GracefulStop
from simpick.training.moving_average import moving_average
from simpick.training.run_folder import TrainingFolder
from simpick.training.state import TrainingState

LOG_STEPS = 20
"""Every so many steps a row of the log reports the losses."""


def train_detector(
    config: DetectorTrainConfig,
    budget: Budget,
    folder: Path,
    *,
    resources: DetectorResources | None = None,
    imagenet_weights: Path | None = None,
    start_from: Path | None = None,
    on_row: Callable[[dict[str, Any], float], None] | None = None,
) -> Path:
    """Train the detector until the budget is spent and return the file of its weights.

    A folder that holds a run of the same configuration resumes where that stopped. Bins that are missing are made in
    `DetectorResources.shards` or the run's own folder, all but the first `min_ready_bins` of them during training: once
    all are there, a step's batch follows from the seed alone. `imagenet_weights` are those of the encoder (see
    `load_imagenet_weights`), `start_from` those of a whole detector; without either, all weights are random.

    Raises:
        OutputError: the folder holds another run, or cannot be written.
        CheckpointError: the weights to start from do not fit.
        ConfigError: the device is to hold all views, and has too little memory.
        SimpickError: the loss is no longer finite.
        KeyboardInterrupt: Ctrl-C or SIGTERM; the current step was finished and the state saved.
    """
    resources = resources or DetectorResources()
    if resources.threads:
        torch.set_num_threads(resources.threads)
    name = resources.device
    device = torch.device(("cuda" if torch.cuda.is_available() else "cpu") if name == "auto" else name)
    # All crops have one size, so that the fastest convolutions need to be found once only.
    torch.backends.cudnn.benchmark = device.type == "cuda"
    run = TrainingFolder(folder, {"training": asdict(config)})
    saved = run.load_state()
    state = _start(config, device, *((None, None) if saved else (imagenet_weights, start_from)))
    if saved:
        run.restore(state, saved)
    _Trainer(config, budget, resources, device, run, state, on_row or (lambda row, progress: None)).run()
    return run.weights


def _start(
    config: DetectorTrainConfig, device: torch.device, imagenet_weights: Path | None, start_from: Path | None
) -> TrainingState[InstanceNetwork]:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        model = InstanceNetwork()
    if imagenet_weights is not None:
        load_imagenet_weights(model.encoder, imagenet_weights)
    if start_from is not None:
        model.load_state_dict(load_detector_checkpoint(start_from).network.state_dict())
    model = model.to(device).to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    frozen = [model.encoder.stem, *model.encoder.stages[: config.frozen_stages]] if config.frozen_stages else []
    for module in frozen:
        module.requires_grad_(False)
    encoder = [p for p in model.encoder.parameters() if p.requires_grad]
    others = [p for name, p in model.named_parameters() if not name.startswith("encoder.")]
    groups = [{"params": encoder, "factor": config.encoder_rate}, {"params": others, "factor": 1.0}]
    optimizer = torch.optim.AdamW(groups, lr=config.learning_rate, weight_decay=config.weight_decay)
    return TrainingState(model.train(), moving_average(model, config.ema_decay), optimizer)


class _Trainer:
    def __init__(
        self,
        config: DetectorTrainConfig,
        budget: Budget,
        resources: DetectorResources,
        device: torch.device,
        run: TrainingFolder,
        state: TrainingState[InstanceNetwork],
        on_row: Callable[[dict[str, Any], float], None],
    ) -> None:
        self.config, self.budget, self.resources, self.device = config, budget, resources, device
        self.run_folder, self.state, self.on_row = run, state, on_row
        self.sums: dict[str, float] = {}
        self.counted = 0

    def run(self) -> None:
        """Train until the budget is spent."""
        if self._progress() >= 1 and self.run_folder.weights.exists():
            return
        folder = self.resources.shards or self.run_folder.shards
        with GracefulStop() as graceful_stop, BinSupply(folder, self.config, self.resources.renderers) as bins:
            bins.wait(graceful_stop)
            validation = DetectorValidation(bins.held_out())
            with self._batches(bins, graceful_stop) as batches:
                self._loop(batches, bins, validation, graceful_stop)

    @contextmanager
    def _batches(self, bins: BinSupply, graceful_stop: GracefulStop) -> Iterator[Iterator[CropBatch]]:
        config, step, loaders = self.config, self.state.step, self.resources.loaders
        is_cuda = self.device.type == "cuda"
        where = self.resources.crops
        if where == "auto":
            where = "device" if is_cuda and do_views_fit(config, self.device) else "loaders"
        if where == "loaders":
            yield crop_batches(config, bins.train, step, loaders, pinned=is_cuda)
            return
        with DeviceViews(config, bins.train, self.device, readers=max(1, loaders)) as views:
            views.wait(graceful_stop)
            yield device_batches(config, views, step)

    def _loop(
        self,
        batches: Iterator[CropBatch],
        bins: BinSupply,
        validation: DetectorValidation,
        graceful_stop: GracefulStop,
    ) -> None:
        last = time.perf_counter()
        validated_s = self.state.seconds
        while self._progress() < 1 and not graceful_stop.requested:
            try:
                batch = next(batches)
            except RuntimeError:
                # A loader that was still starting when all processes were asked to stop.
                if graceful_stop.requested:
                    break
                raise
            self._step(batch)
            now = time.perf_counter()
            self.state.seconds += now - last
            last = now
            if self.state.step % LOG_STEPS == 0:
                self._log(bins)
            if self.state.seconds - validated_s >= self.resources.validate_every_s:
                validated_s = self.state.seconds
                self._validate(validation)
                # Validation is not training: its time is not charged.
                last = time.perf_counter()
        if graceful_stop.requested:
            self.run_folder.save_state(self.state.save())
            raise KeyboardInterrupt
        self._validate(validation)

    def _step(self, batch: CropBatch) -> None:
        config, state = self.config, self.state
        rate = config.learning_rate_at(state.step, min(1.0, self._progress()))
        for group in state.optimizer.param_groups:
            group["lr"] = rate * group["factor"]
        batch = batch.to(self.device)
        with torch.autocast(self.device.type, torch.bfloat16):
            maps = state.model(batch.rgb.float().contiguous(memory_format=torch.channels_last))
        terms = loss_terms(maps, batch)
        loss = weighted_sum(terms, config.losses)
        state.descend(loss, config.max_grad_norm)
        for name, value in {**terms, "loss": loss}.items():
            self.sums[name] = self.sums.get(name, 0.0) + float(value.detach())
        self.counted += 1

    def _log(self, bins: BinSupply) -> None:
        means = {name: round(value / self.counted, 4) for name, value in self.sums.items()}
        self.sums, self.counted = {}, 0
        rate = self.state.step * self.config.batch / max(self.state.seconds, 1e-9)
        counts = {"bins": len(bins.train()), "bins_left_out": bins.left_out}
        self._row("train", {**means, "crops_per_s": round(rate, 2), **counts})

    def _validate(self, validation: DetectorValidation) -> None:
        # The state first: a decoder that fails must not cost what was learned.
        self.run_folder.save_state(self.state.save())
        figures, score = validation.measure(self.state.averaged_model)
        self._row("validation", figures)
        card = {"training": json.loads(json.dumps(asdict(self.config))), "validation": figures}
        card |= {"steps": self.state.step, "hours": self.state.seconds / 3600}
        save_detector_checkpoint(self.run_folder.weights, self.state.averaged_model, score, card)

    def _row(self, split: str, figures: dict[str, float]) -> None:
        row = {"step": self.state.step, "seconds": round(self.state.seconds, 1), "split": split, **figures}
        self.run_folder.log(row)
        self.on_row(row, min(1.0, self._progress()))

    def _progress(self) -> float:
        return self.budget.progress(self.state.step, self.state.seconds)
