"""Every field of the configuration is read, and means something."""

import ast
import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from simpick.config import from_json
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.raypose.network.config import PRESETS, RayPoseConfig, preset
from simpick.estimators.raypose.network.model import RayPose
from tests.estimators.raypose.networks import TINY, awake, condition, noisy_maps, random_query, random_templates

ROOT = Path(__file__).parents[4]
FIELDS = [field.name for field in dataclasses.fields(RayPoseConfig)]


def parameter_shapes(config: RayPoseConfig) -> Any:
    return {name: tuple(tensor.shape) for name, tensor in RayPose(config).state_dict().items()}


def answer(config: RayPoseConfig) -> Any:
    """Return the clean maps and reference of the same weights, images and noise."""
    with torch.inference_mode():
        conditioning = condition(awake(config), random_query(1, config), random_templates(1, config))
        maps = awake(config).denoise(noisy_maps(1, config), torch.tensor([-2.0]), conditioning)
    return np.concatenate([maps.numpy().ravel(), conditioning.reference.R.numpy().ravel()]).round(5).tolist()


CHANGES: dict[str, tuple[dict[str, Any], Callable[[RayPoseConfig], Any]]] = {
    "crop_px": ({"crop_px": 96, "local_cells": 12}, lambda c: random_query(1, c).rgb.shape),
    "padding": ({"padding": 1.5}, answer),
    "local_cells": ({"crop_px": 96, "local_cells": 12}, parameter_shapes),
    "map_cells": ({"map_cells": 2}, parameter_shapes),
    "local_width": ({"local_width": 32}, parameter_shapes),
    "match_width": ({"match_width": 8}, parameter_shapes),
    "width": ({"width": 48}, parameter_shapes),
    "heads": ({"heads": 4}, answer),
    "fuser_blocks": ({"fuser_blocks": 2}, parameter_shapes),
    "decoder_blocks": ({"decoder_blocks": 2}, parameter_shapes),
    "fourier_bands": ({"fourier_bands": 2}, parameter_shapes),
    "templates": ({"templates": 4}, parameter_shapes),
    "matching": ({"matching": False, "flow": False}, answer),
    "flow": ({"flow": False}, answer),
    "flow_width": ({"flow_width": 8}, parameter_shapes),
    "flow_radius": ({"flow_radius": 3}, parameter_shapes),
    "relative_pose": ({"relative_pose": False}, answer),
    "multiview": ({"multiview": False}, answer),
    "template_pose": ({"template_pose": False, "flow": False}, answer),
}
# DINOv2 has tests of its own; which templates are drawn is decided in training batches.
ELSEWHERE = {"image_encoder", "template_views", "spread_deg", "spread_m"}


def test_every_field_is_covered_here() -> None:
    assert sorted(FIELDS) == sorted({*CHANGES, *ELSEWHERE})


@pytest.mark.parametrize("name", CHANGES)
def test_every_field_changes_the_network(name: str) -> None:
    change, observe = CHANGES[name]
    assert observe(TINY) == observe(TINY)
    assert observe(dataclasses.replace(TINY, **change)) != observe(TINY)


@functools.cache
def attributes_read() -> set[str]:
    files = [*(ROOT / "estimators/raypose").rglob("*.py"), *(ROOT / "simpick/training").rglob("*.py")]
    return {
        node.attr
        for file in files
        if file.name != "config.py"
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)
    }


@pytest.mark.parametrize("name", FIELDS)
def test_every_field_is_read_outside_the_configuration(name: str) -> None:
    # What properties of the configuration are made of counts as read where they are.
    names = {name} | {"image_encoder": {"is_dino"}, "spread_deg": {"is_fine"}}.get(name, set())
    assert names & attributes_read()


def test_configurations_survive_json() -> None:
    for config in PRESETS.values():
        assert from_json(RayPoseConfig, config.to_json(), complete=True) == config


def test_the_small_size_is_under_16_mib_in_half_precision() -> None:
    tensors = RayPose(preset("small")).state_dict().values()
    assert sum(tensor.numel() for tensor in tensors) * 2 < 16 * 2**20


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"width": 0}, "width must be at least 1, got 0"),
        ({"templates": 0}, "templates must be at least 1, got 0"),
        ({"fuser_blocks": -1}, "fuser_blocks must be at least 0, got -1"),
        ({"map_cells": 4}, "map_cells must divide local_cells, got map_cells=4, local_cells=6"),
        (
            {"crop_px": 50},
            "crop_px must be 8 times local_cells, the stride of 'simpick', got crop_px=50, local_cells=6",
        ),
        ({"image_encoder": "dinov2_vits14"}, "crop_px must be 14 times local_cells, the stride of 'dinov2_vits14'"),
        ({"local_width": 34}, "local_width must be a width that groups divide, as multiples of 24 are, got 34"),
        ({"local_width": 2}, "local_width must be a width that groups divide, as multiples of 24 are, got 2"),
        ({"heads": 3}, "heads must divide width, got heads=3, width=32"),
        ({"padding": 0.9}, "padding must be between 1 and 3, got 0.9"),
        ({"spread_deg": 0.0}, "spread_deg must be above 0 and at most 180, got 0.0"),
        ({"spread_m": -0.1}, "spread_m must be between 0 and 0.5, got -0.1"),
    ],
)
def test_what_makes_no_sense_is_refused(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        dataclasses.replace(TINY, **change)
    assert text in str(caught.value)


def test_sizes_have_names() -> None:
    with pytest.raises(UnknownNameError) as caught:
        preset("smal")
    assert str(caught.value) == "no RayPose size named 'smal'. Valid: base, paper, small, tiny. Did you mean 'small'?"
