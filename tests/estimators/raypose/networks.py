"""A tiny network with random weights everywhere, and random inputs for it."""

import dataclasses

import torch

from simpick.estimators.raypose.network.config import RayPoseConfig, preset
from simpick.estimators.raypose.network.model import Conditioning, RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import QueryInputs, TemplateInputs
from simpick.geometry.torch_rotations import random_rotations

TINY = dataclasses.replace(preset("tiny"), templates=3)


def without(switch: str, config: RayPoseConfig = TINY) -> RayPoseConfig:
    """Return the configuration with a switch off, and flow with it where that needs it."""
    flow = config.flow and switch not in ("flow", "matching", "template_pose")
    return dataclasses.replace(config, **{switch: False, "flow": flow})


def awake(config: RayPoseConfig = TINY, seed: int = 0) -> RayPose:
    """Return a network whose zero-initialised layers are random too, so that everything has an effect."""
    torch.manual_seed(seed)
    model = RayPose(config)
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in model.parameters():
            if parameter.ndim and not parameter.any():
                parameter.normal_(0, 0.05, generator=generator)
    return model.eval()


def random_views(shape: tuple[int, ...], generator: torch.Generator, dtype: torch.dtype = torch.float32) -> ViewPoses:
    centre = 0.3 * (2 * torch.rand((*shape, 2), generator=generator, dtype=dtype) - 1)
    reach = 0.03 * (1 + torch.rand(shape, generator=generator, dtype=dtype))
    return ViewPoses(random_rotations(shape, generator, dtype), centre, reach)


def random_query(batch: int, config: RayPoseConfig = TINY, seed: int = 1) -> QueryInputs:
    generator = torch.Generator().manual_seed(seed)
    size = config.crop_px
    masks = torch.zeros(batch, size, size)
    masks[:, size // 8 : size // 2 + 9, size // 4 : -size // 8] = 1.0
    rgb = torch.rand((batch, 3, size, size), generator=generator)
    return QueryInputs(rgb, masks, 0.03 + 0.05 * torch.rand(batch, generator=generator))


def random_templates(batch: int, config: RayPoseConfig = TINY, seed: int = 2) -> TemplateInputs:
    generator = torch.Generator().manual_seed(seed)
    size, shape = config.crop_px, (batch, config.templates)
    masks = torch.zeros(*shape, size, size)
    masks[:, :, size // 4 : -size // 4, size // 8 : -size // 8] = 1.0
    cells = config.geometry_cells**2
    points = torch.rand((*shape, cells, 3), generator=generator) - 0.5
    return TemplateInputs(
        torch.rand((*shape, 3, size, size), generator=generator),
        masks,
        0.03 + 0.05 * torch.rand(shape, generator=generator),
        random_views(shape, generator),
        points,
        torch.rand((*shape, cells), generator=generator),
        0.05 + 0.05 * torch.rand(batch, generator=generator),
    )


def condition(model: RayPose, query: QueryInputs, templates: TemplateInputs) -> Conditioning:
    return model.condition(model.encode_query(query), model.fuse(model.encode_templates(templates)))


def noisy_maps(batch: int, config: RayPoseConfig = TINY, seed: int = 3) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn((batch, config.templates, config.map_cells, config.map_cells, 6), generator=generator)
