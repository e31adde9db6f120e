"""The analytic Jacobians against finite differences, and the maps they rest on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.estimators.refiner.alignment import Target, align, moved, projection_jacobian
from simpick.estimators.refiner.blurring import blur, eroded
from simpick.estimators.refiner.confidence import FEATURES
from simpick.estimators.refiner.config import RefinerConfig
from simpick.estimators.refiner.crop_renderer import CropRenderer
from simpick.estimators.refiner.evidence import evidence
from simpick.estimators.refiner.query_maps import QueryMaps
from simpick.estimators.refiner.rendered_maps import rendered_maps
from simpick.geometry import Pinhole, VirtualCameras, so3_exp, transform
from simpick.rendering import PartRenderer

SIZE, FOCAL = 64, 700.0
CAMERAS = VirtualCameras(SIZE, np.array([FOCAL]), np.eye(3)[None])
T_CROP_PART = transform(so3_exp(np.array([0.5, -0.4, 0.8])), np.array([0.004, -0.003, 0.9]))


def test_projection_moves_as_the_jacobian_says():
    T, step = T_CROP_PART, 1e-6
    pixel, depth_m = np.array([40.5, 21.5]), 0.93
    ray = np.array([*(pixel - SIZE / 2) / FOCAL, 1.0])
    point_part = np.linalg.inv(T) @ np.append(depth_m * ray, 1.0)
    nearness = torch.full((1, SIZE, SIZE), T[2, 3] / depth_m)
    centres = torch.tensor(T[:2, 3] / T[2, 3])[None].float()
    flow_x, flow_y = projection_jacobian(nearness, centres, torch.tensor([FOCAL]))
    for k in range(6):
        ends = [(moved(T[None], sign * step * np.eye(6)[k : k + 1])[0] @ point_part)[:3] for sign in (1, -1)]
        numeric = (ends[0][:2] / ends[0][2] - ends[1][:2] / ends[1][2]) / (2 * step)
        analytic = np.array([flow_x[0, k, 21, 40], flow_y[0, k, 21, 40]])
        assert analytic == pytest.approx(numeric, abs=2e-5)


def banded(name: str) -> Part:
    """Return a part with a bright and a dark half."""
    part = get_part(name)
    bright = np.asarray(part.mesh.triangles_center) @ [0.3, 0.8, 0.5] > 0
    return replace(part, face_rgb=np.where(bright[:, None], np.uint8(220), np.uint8(60)) * np.ones(3, np.uint8))


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("part", [get_part("l_bracket"), banded("l_bracket")], ids=["one colour", "two colours"])
def test_the_cost_falls_as_the_gradient_says(part, stride):
    config = RefinerConfig()
    focal_px = torch.tensor([FOCAL])
    with PartRenderer(part, SIZE, SIZE) as renderer, CropRenderer(1, SIZE) as crops:
        seen = renderer.render(T_CROP_PART[None], CAMERAS.pinhole(0))
        assert seen.rgb is not None
        gray, mask = torch.from_numpy(seen.rgb).float().mean(-1) / 255, torch.from_numpy(seen.masks).float()
        target = Target.of(gray / (gray * mask).sum() * mask.sum(), mask, torch.ones_like(mask), focal_px, 2.5, stride)

        def aligned(T):
            maps = crops.maps([part], CAMERAS, T[None])
            return align(target, maps, torch.tensor(T[:2, 3] / T[2, 3])[None].float(), config)

        off = moved(T_CROP_PART[None], np.array([[0.08, -0.06, 0.05, 1e-3, -1e-3, 0.03]]))
        gradient = 2 * aligned(off[0]).gradient[0].double().numpy()
        # Silhouettes of pixels are rough: a step must be some pixels' worth of motion.
        sizes = np.array([0.03, 0.03, 0.03, 7e-4, 7e-4, 0.03])
        costs = [
            [float(aligned(moved(off, sign * size * axis[None])[0]).cost[0]) for sign in (1, -1)]
            for size, axis in zip(sizes, np.eye(6), strict=True)
        ]
    numeric = np.array([ahead - behind for ahead, behind in costs])
    analytic = gradient * 2 * sizes
    cosine = analytic @ numeric / np.linalg.norm(analytic) / np.linalg.norm(numeric)
    assert cosine > 0.95
    assert np.linalg.norm(analytic) == pytest.approx(np.linalg.norm(numeric), rel=0.3)


def test_the_albedo_is_that_of_the_surface_whatever_its_slope():
    part = banded("l_bracket")
    with CropRenderer(2, SIZE) as crops:
        maps = crops.maps([part, get_part("hex_nut")], CAMERAS.rows(np.array([0, 0])), np.stack([T_CROP_PART] * 2))
    covered = maps.silhouette[0] > 0
    values = maps.albedo[0][covered]
    bright, dark = values[values > 1], values[values <= 1]
    assert len(bright) > 50 and len(dark) > 50
    assert float(values.mean()) == pytest.approx(1.0, abs=1e-4)
    assert float(bright.median() / dark.median()) == pytest.approx(220 / 60, rel=0.05)
    assert float(bright.std() / bright.mean()) < 0.05
    assert (maps.albedo[0][~covered] == 1).all()
    assert (maps.albedo[1] == 1).all()


def test_brightness_of_two_colours_is_explained_by_the_colours():
    part = banded("l_bracket")
    with PartRenderer(part, SIZE, SIZE) as renderer, CropRenderer(1, SIZE) as crops:
        seen = renderer.render(T_CROP_PART[None], CAMERAS.pinhole(0))
        maps = crops.maps([part], CAMERAS, T_CROP_PART[None])
    assert seen.rgb is not None
    gray, mask = torch.from_numpy(seen.rgb).float().mean(-1) / 255, torch.from_numpy(seen.masks).float()
    query = QueryMaps(gray / (gray * mask).sum() * mask.sum(), mask, torch.ones_like(mask), CAMERAS)
    shading = FEATURES.index("shading")
    with_colours, without = (float(evidence(query, m)[0, shading]) for m in (maps, replace(maps, albedo=mask * 0 + 1)))
    assert with_colours > 0.9
    assert without < with_colours - 0.2


def test_normals_of_a_tilted_plane_are_exact():
    camera = Pinhole(SIZE, SIZE, FOCAL, FOCAL, SIZE / 2, SIZE / 2)
    normal = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    rows, columns = np.mgrid[:SIZE, :SIZE] + 0.5
    rays = camera.back_project(np.stack([columns, rows], -1), np.ones((SIZE, SIZE)))
    depth_m = torch.tensor(0.7 / (rays @ normal), dtype=torch.float32)[None]
    maps = rendered_maps(depth_m, torch.tensor([0.9]), torch.tensor([FOCAL]))
    assert np.abs(maps.normals[0].permute(1, 2, 0).numpy() - normal).max() < 5e-3


def test_a_coarse_blur_lies_amid_its_block():
    x, _ = torch.meshgrid(torch.arange(32.0), torch.arange(32.0), indexing="xy")
    coarse = blur(x[None], 1.5, 2)
    assert coarse.shape == (1, 16, 16)
    # A ramp stays a ramp; pixels 10 and 11 make block 5.
    assert float(coarse[0, 8, 5]) == pytest.approx(10.5, abs=1e-2)


@pytest.mark.parametrize(("deviation_px", "stride"), [(2.5, 2), (1.5, 2), (1.2, 2), (1.0, 1)])
def test_blurs_have_no_denormal_values_which_would_slow_all_that_follows(deviation_px: float, stride: int):
    point = torch.zeros(1, 96, 96)
    point[0, 48, 48] = 1.0
    values = blur(point, deviation_px, stride)
    assert values[values > 0].min() > torch.finfo(torch.float32).tiny
    assert float(values.sum()) * stride**2 == pytest.approx(1.0, abs=1e-4)


def test_blocks_and_gaussian_together_blur_as_the_gaussian_asked_for():
    maps = torch.zeros(1, 48, 48)
    maps[0, 20:30, 15:33] = 1.0
    fine = blur(maps, 2.5)
    blocks = fine.reshape(1, 24, 2, 24, 2)
    # At the blocks' centres lies the mean of four pixels of the full blur, but for the curvature in between.
    assert float((blur(maps, 2.5, 2) - blocks.mean(dim=(2, 4))).abs().max()) < 0.02


def test_erosion_takes_the_least_of_nine_pixels():
    maps = torch.ones(1, 6, 6)
    maps[0, 2, 3] = 0.0
    shrunk = torch.ones(1, 6, 6)
    shrunk[0, 1:4, 2:5] = 0.0
    assert torch.equal(eroded(maps), shrunk)
