"""The paper's ablations (tables 2 and 3) and the comparison of noise schedules, as runs of equal budget.

A variant changes only the configurations of network and training.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from simpick.caching import atomic_write_text
from simpick.estimators.raypose.checkpoints import load_checkpoint
from simpick.estimators.raypose.diffusion.schedule import SCHEDULES, make_schedule
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.model import RayPose
from simpick.training.budget import Budget
from simpick.training.config import TrainConfig
from simpick.training.resources import Resources
from simpick.training.trainer import train
from simpick.training.validation import Validation

COMMON_SPREAD = {"spread_deg": 30.0, "spread_m": 0.05}
"""The paper's templates, with which every variant is measured in addition to its own."""
UNTRAINED = "untrained"
"""Name of the row without training."""
SAMPLING_STEPS = (1, 3, 5, 10)
"""Denoising steps at which schedules are compared."""


@dataclass(frozen=True)
class Variant:
    """One run, by its differences from the full fine predictor."""

    name: str
    """Name of its folder."""
    label: str
    """Name in the table."""
    network: Mapping[str, Any] = field(default_factory=dict)
    """Fields of `RayPoseConfig`."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Fields of `TrainConfig`."""


FULL = Variant("fine", "fine, 30 deg / 5 cm (full)", COMMON_SPREAD)
COARSE = Variant("coarse", "coarse, random templates", {"spread_deg": 180.0})
COMPONENTS = (
    FULL,
    COARSE,
    Variant("absolute", "absolute pose", {**COMMON_SPREAD, "relative_pose": False}),
    Variant("single_view", "single view", {**COMMON_SPREAD, "multiview": False}),
    Variant("no_template_pose", "without template pose", {**COMMON_SPREAD, "template_pose": False, "flow": False}),
    Variant("no_flow", "without flow", {**COMMON_SPREAD, "flow": False}),
    Variant(
        "no_matching", "without matching and flow (as the paper)", {**COMMON_SPREAD, "matching": False, "flow": False}
    ),
)
"""Table 2 of the paper, and runs without matching and flow, which are not in the paper."""
TEMPLATES = (
    COARSE,
    Variant("coarse_fixed", "coarse, fixed templates", {"spread_deg": 180.0, "template_views": "fixed"}),
    Variant("fine_90", "fine, 90 deg / 10 cm", {"spread_deg": 90.0, "spread_m": 0.10}),
    FULL,
    Variant("fine_15", "fine, 15 deg / 3 cm", {"spread_deg": 15.0, "spread_m": 0.03}),
)
"""Table 3 of the paper."""
SCHEDULE_VARIANTS = tuple(
    Variant(f"schedule_{name}", name, COMMON_SPREAD, {"schedule": name}) for name in SCHEDULES
)  # fmt: skip


@dataclass(frozen=True)
class Ablation:
    """The settings that all variants of a comparison share."""

    network: RayPoseConfig
    training: TrainConfig
    budget: Budget
    """Budget of each variant."""
    folder: Path
    """Holds one folder per variant, and the data, which are the same for all."""
    resources: Resources = field(default_factory=Resources)

    def network_of(self, variant: Variant) -> RayPoseConfig:
        """Return the network of a variant."""
        return dataclasses.replace(self.network, **variant.network)

    def training_of(self, variant: Variant) -> TrainConfig:
        """Return the training of a variant."""
        return dataclasses.replace(self.training, **variant.training)

    @property
    def shards(self) -> Path:
        """Return the folder of the data."""
        return self.resources.shards or self.folder / "shards"

    def run(self, variant: Variant, on_row: Callable[[dict[str, Any], float], None] | None = None) -> Path:
        """Train a variant, or resume it, and return its weights; a finished variant is not trained again."""
        resources = dataclasses.replace(self.resources, shards=self.shards)
        network, training = self.network_of(variant), self.training_of(variant)
        return train(network, training, self.budget, self.folder / variant.name, resources=resources, on_row=on_row)


def measure(ablation: Ablation, variant: Variant) -> dict[str, Any]:
    """Return held-out figures of sampled poses with the variant's own templates and with the common ones."""
    checkpoint = load_checkpoint(ablation.folder / variant.name / "weights.safetensors")
    schedule = make_schedule(ablation.training_of(variant).schedule)
    common = dataclasses.replace(checkpoint.model.config, **COMMON_SPREAD)
    rows = {
        kind: _validation(ablation, network).measure_denoised(checkpoint.model, schedule)
        for kind, network in (("own", checkpoint.model.config), ("common", common))
    }
    return {"name": variant.name, "label": variant.label, "queries": checkpoint.card["queries"], **rows}


def measure_untrained(ablation: Ablation) -> dict[str, Any]:
    """Return the figures of `measure` without training: of the mean of the templates' poses that agree."""
    # Without matching, an untrained network predicts the poses of the templates.
    fields = {**COMMON_SPREAD, "matching": False, "flow": False, "relative_pose": True}
    network = dataclasses.replace(ablation.network, **fields)
    schedule = make_schedule(ablation.training.schedule)
    figures = _validation(ablation, network).measure_denoised(RayPose(network), schedule)
    label = "no training: the templates' mean"
    return {"name": UNTRAINED, "label": label, "queries": 0, "own": figures, "common": figures}


def measure_steps(ablation: Ablation, variant: Variant) -> list[dict[str, Any]]:
    """Return held-out figures for each number of denoising steps, with milliseconds per query."""
    checkpoint = load_checkpoint(ablation.folder / variant.name / "weights.safetensors")
    schedule = make_schedule(ablation.training_of(variant).schedule)
    rows = []
    for steps in SAMPLING_STEPS:
        validation = _validation(ablation, checkpoint.model.config, steps)
        validation.measure_denoised(checkpoint.model, schedule)  # The first pass through a network is slower.
        start = time.perf_counter()
        figures = validation.measure_denoised(checkpoint.model, schedule)
        taken_ms = 1e3 * (time.perf_counter() - start) / validation.queries
        rows.append({"label": variant.label, "steps": steps, "ms_per_query": taken_ms, **figures})
    return rows


def tables(results: Sequence[Mapping[str, Any]]) -> str:
    """Return both tables of the paper, for our data, as Markdown."""
    by_name = {result["name"]: result for result in results}
    parts = []
    untrained = [by_name[UNTRAINED]] if UNTRAINED in by_name else []
    for title, variants in (("Components (table 2)", COMPONENTS), ("Templates in training (table 3)", TEMPLATES)):
        rows = untrained + [by_name[variant.name] for variant in variants if variant.name in by_name]
        parts.append(f"## {title}\n\n{_table(rows)}")
    return (
        "# Ablations\n\nSampled poses of held-out random parts: median rotation error, shares below 5, 15 and 30 deg, "
        "median depth error. *Own*: templates as in the variant's training. *Common*: within "
        f"{COMMON_SPREAD['spread_deg']:g} deg and {100 * COMMON_SPREAD['spread_m']:g} cm for all.\n\n"
        + "\n".join(parts)
    )


def schedule_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the comparison of schedules as Markdown."""
    lines = [
        "# Noise schedules\n\nSampled poses of held-out random parts; time of templates, encoding and sampling.\n",
        "| schedule | steps | median [deg] | < 5 deg | < 15 deg | < 30 deg | depth [%] | ms per query |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['label']} | {row['steps']} | {_figures(row)} | {row['ms_per_query']:.1f} |" for row in rows
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def write_results(folder: Path, name: str, results: Sequence[Mapping[str, Any]], text: str) -> list[Path]:
    """Write the figures as JSON and the tables as Markdown; return both files."""
    files = [folder / f"{name}.json", folder / f"{name}.md"]
    atomic_write_text(files[0], json.dumps(list(results), indent=2) + "\n")
    atomic_write_text(files[1], text)
    return files


def _validation(ablation: Ablation, network: RayPoseConfig, steps: int | None = None) -> Validation:
    config = ablation.training
    config = dataclasses.replace(config, validation_steps=steps or config.validation_steps)
    return Validation.held_out(ablation.shards, network, config)


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    lines = [
        "| variant | queries | templates | median [deg] | < 5 deg | < 15 deg | < 30 deg | depth [%] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['label']} | {row['queries']} | {kind} | {_figures(row[kind])} |"
        for row in rows
        for kind in (("common",) if row["name"] == UNTRAINED else ("own", "common"))
    ]
    return "\n".join(lines) + "\n"


def _figures(row: Mapping[str, Any]) -> str:
    shares = " | ".join(f"{row[name]:.0%}" for name in ("below_5_deg", "below_15_deg", "below_30_deg"))
    return f"{row['rotation_deg']:.1f} | {shares} | {row['depth_percent']:.1f}"
