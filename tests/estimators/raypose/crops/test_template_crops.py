"""Crops of crops and of templates: exact cameras, against projection and against renderings."""

import dataclasses

import numpy as np
import pytest
import torch

from simpick.errors import ConfigError
from simpick.estimators.raypose.crops.aimed_templates import aim_at_templates
from simpick.estimators.raypose.crops.template_crops import TemplateCrops, TemplateImages, collate, crop_templates
from simpick.estimators.raypose.crops.virtual_recrops import aim_virtual_recrops, sample_virtual_recrops
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.geometry import Pinhole, SymmetryGroup, rotation_angle, so3_exp, transform, transform_points
from simpick.rendering import TemplateSet
from simpick.rendering.part_views import PartRenderer

CONFIG = RayPoseConfig(crop_px=96, local_cells=12, map_cells=6)
VIEWS = np.array([0, 5, 17, 30])
ANGLES = np.array([0.0, 0.7, -2.0, 3.0])


@pytest.fixture(scope="module")
def crops(templates: TemplateSet) -> TemplateCrops:
    return crop_templates(TemplateImages.of(templates), aim_at_templates(templates, VIEWS, ANGLES, CONFIG), CONFIG)


def test_a_recrop_sees_directions_where_its_camera_says() -> None:
    # Images whose two channels are the tangents of each pixel's ray.
    source, focal = 80, np.array([120.0, 300.0])
    axis = torch.arange(source) + 0.5 - source / 2
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    images = torch.stack([torch.stack([x, y]) / f for f in (120.0, 300.0)])
    boxes = np.array([[20.0, 25.0, 50.0, 45.0], [35.0, 30.0, 60.0, 60.0]])
    recrops = aim_virtual_recrops(source, focal, np.array([0.0, 0.0]), boxes, 32, padding=1.2)
    seen = sample_virtual_recrops(images, focal, recrops)
    camera = [Pinhole(32, 32, f, f, 16.0, 16.0) for f in recrops.focal_px]
    for k in range(2):
        rays = camera[k].rays() @ recrops.Rs_crop_source[k]  # R^T applied to rows: into the source's frame
        tangents = rays[..., :2] / rays[..., 2:]
        np.testing.assert_allclose(seen[k].numpy().transpose(1, 2, 0), tangents, atol=1e-4)


def test_a_recrop_is_centred_on_its_box_and_padded() -> None:
    boxes = np.array([[20.0, 30.0, 60.0, 50.0]])
    recrops = aim_virtual_recrops(80, np.array([1e5]), np.zeros(1), boxes, 32, padding=1.25)
    # At such a focal length there is no perspective: half the crop is half the longer side times the padding.
    assert recrops.half_tangent[0] * 1e5 == pytest.approx(20 * 1.25, rel=1e-3)
    axis_in_source = recrops.Rs_crop_source[0].T @ np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(1e5 * axis_in_source[:2] / axis_in_source[2] + 40, [40.0, 40.0], atol=1e-3)
    halved = recrops.halved()
    assert (halved.size_px, halved.half_tangent[0]) == (16, pytest.approx(recrops.half_tangent[0]))


def test_a_turned_recrop_turns_its_picture_clockwise() -> None:
    image = torch.zeros(1, 1, 80, 80)
    image[..., 20:24, 38:42] = 1.0  # above the middle
    whole = np.array([[0.0, 0.0, 80.0, 80.0]])
    recrops = aim_virtual_recrops(80, np.array([1e5]), np.array([np.pi / 2]), whole, 80, padding=1.0)
    seen = sample_virtual_recrops(image, np.array([1e5]), recrops)[0, 0]
    rows, columns = torch.nonzero(seen > 0.5, as_tuple=True)
    # A quarter turn clockwise moves it to the right.
    assert (rows.float().mean().item() + 0.5, columns.float().mean().item() + 0.5) == pytest.approx((40, 58), abs=0.6)


def test_beyond_the_source_there_is_nothing() -> None:
    recrops = aim_virtual_recrops(
        80, np.array([100.0]), np.zeros(1), np.array([[60.0, 20.0, 100.0, 60.0]]), 32, padding=1.0
    )
    seen = sample_virtual_recrops(torch.ones(1, 1, 80, 80), np.array([100.0]), recrops)[0, 0]
    assert seen[:, :14].min().item() == pytest.approx(1)
    assert seen[:, 18:].max() == 0


def test_boxes_without_area_are_refused() -> None:
    with pytest.raises(ConfigError, match="box 0 must have x1 < x2"):
        aim_virtual_recrops(80, np.array([100.0]), np.zeros(1), np.array([[30.0, 30.0, 30.0, 40.0]]), 32, padding=1.0)


@pytest.mark.render
def test_points_project_into_their_cells(crops: TemplateCrops) -> None:
    # Cells wholly on the part show a mean point; seen from the crop's camera it lies in the cell's middle.
    for k, T in enumerate(crops.Ts_crop_part):
        full = (crops.coverage[k] > 0.999).numpy()
        assert full.sum() > 10
        points = transform_points(T, crops.points_m[k].double().numpy()[full])
        seen = points[:, :2] / points[:, 2:] / crops.half_tangent[k]
        axis = (np.arange(24) + 0.5) / 12 - 1
        centres = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)[full]
        # A slanted surface's mean lies a little off; a cell is 1/12 wide.
        assert np.abs(seen - centres).max() < 0.02


@pytest.mark.render
def test_points_lie_on_the_part_and_uncovered_cells_have_none(crops: TemplateCrops, wedge) -> None:
    low, high = wedge.mesh.bounds
    covered = crops.coverage > 0
    points = crops.points_m[covered].numpy()
    assert ((points > low - 1e-3) & (points < high + 1e-3)).all()
    assert (crops.points_m[~covered] == 0).all()
    torch.testing.assert_close(
        crops.coverage, torch.nn.functional.adaptive_avg_pool2d(crops.masks[:, None], 24).flatten(1), atol=0.2, rtol=0
    )


@pytest.mark.render
def test_a_turned_template_is_what_its_pose_looks_like(crops: TemplateCrops, wedge) -> None:
    size = CONFIG.crop_px
    cameras = [Pinhole(size, size, f, f, size / 2, size / 2) for f in size / 2 / crops.half_tangent]
    with PartRenderer(wedge, size, size) as renderer:
        views = renderer.render(crops.Ts_crop_part, cameras)
    assert views.rgb is not None
    for k in range(len(crops)):
        ours, rendered = crops.masks[k].numpy() > 0.5, views.masks[k]
        overlap = (ours & rendered).sum() / (ours | rendered).sum()
        assert overlap > 0.97
        inside = ours & rendered & (crops.masks[k].numpy() > 0.99)
        image = crops.rgb[k].permute(1, 2, 0).numpy()[inside] - views.rgb[k][inside] / 255
        assert np.abs(image).mean() < 0.02


@pytest.mark.render
def test_silhouettes_fill_the_padded_box(crops: TemplateCrops) -> None:
    for mask in crops.masks.numpy() > 0.5:
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        longer = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
        assert longer == pytest.approx(CONFIG.crop_px / CONFIG.padding, abs=3)
        assert (rows[0] + rows[-1] + 1) / 2 == pytest.approx(48, abs=2)
        assert (columns[0] + columns[-1] + 1) / 2 == pytest.approx(48, abs=2)


@pytest.mark.render
def test_shift_and_zoom_move_the_frame(templates: TemplateSet, crops: TemplateCrops) -> None:
    shift, zoom = np.tile([0.1, -0.05], (4, 1)), np.full(4, 1.25)
    aimed = aim_at_templates(templates, VIEWS, ANGLES, CONFIG, shift=shift, zoom=zoom)
    moved = crop_templates(TemplateImages.of(templates), aimed, CONFIG)
    np.testing.assert_allclose(moved.half_tangent / crops.half_tangent, 1.25, rtol=0.01)
    for k in range(4):
        before, after = (
            c.Ts_crop_part[k, :2, 3] / c.Ts_crop_part[k, 2, 3] / crops.half_tangent[k] for c in (crops, moved)
        )
        # The crop moved by the share of the box's longer side, so the part moved the other way: 2 half sides / padding.
        np.testing.assert_allclose(after - before, np.array([-0.1, 0.05]) * 2 / CONFIG.padding, atol=0.01)


@pytest.mark.render
def test_equivalent_poses_nearest_to_a_pose_agree(templates: TemplateSet, crops: TemplateCrops) -> None:
    # Of order 3, where an element and its inverse differ.
    group = SymmetryGroup.cyclic(3)
    T_query = crops.Ts_crop_part[0] @ transform(so3_exp(np.array([0.0, 0.0, 2 * np.pi / 3 + 0.2])))
    aimed = aim_at_templates(templates, VIEWS, ANGLES, CONFIG)
    near = crop_templates(TemplateImages.of(templates), aimed.nearest_to(T_query, group), CONFIG)
    Rs, old = near.Ts_crop_part[:, :3, :3], crops.Ts_crop_part[:, :3, :3]
    distance = rotation_angle(np.swapaxes(Rs, -1, -2) @ T_query[:3, :3])
    np.testing.assert_allclose(distance, group.rotation_distance(old, T_query[:3, :3]), atol=1e-6)
    assert (rotation_angle(np.swapaxes(old, -1, -2) @ T_query[:3, :3]) > distance + 0.1).any()
    # Images stay, and so does where each point is seen.
    assert torch.equal(near.rgb, crops.rgb)
    for k in range(len(crops)):
        covered = (crops.coverage[k] > 0).numpy()
        before = transform_points(crops.Ts_crop_part[k], crops.points_m[k].double().numpy()[covered])
        after = transform_points(near.Ts_crop_part[k], near.points_m[k].double().numpy()[covered])
        np.testing.assert_allclose(after, before, atol=1e-6)
        assert (near.points_m[k][~torch.from_numpy(covered)] == 0).all()
    assert aimed.nearest_to(T_query, SymmetryGroup()) is aimed


@pytest.mark.render
def test_batches_are_in_diameters_and_half_sides(crops: TemplateCrops, wedge) -> None:
    other = dataclasses.replace(crops, points_m=2 * crops.points_m)
    batch = collate([crops, other], [wedge.diameter_m, 0.5])
    assert batch.rgb.shape == (2, 4, 3, 96, 96)
    torch.testing.assert_close(batch.points[1], 4 * crops.points_m)
    torch.testing.assert_close(batch.points[0] * wedge.diameter_m, crops.points_m)
    poses = batch.poses.pose(batch.half_tangent)
    torch.testing.assert_close(poses[0].double(), torch.from_numpy(crops.Ts_crop_part), atol=1e-5, rtol=1e-5)
