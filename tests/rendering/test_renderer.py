import mujoco
import numpy as np
import pytest

from simpick.errors import ConfigError, RenderingUnavailableError, UnknownNameError
from simpick.geometry import Pinhole, random_rotation, transform, transform_points
from simpick.rendering import PartRenderer, Renderer, RenderQuality, SceneRenderer, Viewpoint, render_part_views

from .conftest import CAMERA

pytestmark = pytest.mark.render

OFF_CENTRE = Pinhole(120, 90, 260.0, 244.0, 75.3, 31.8)


def poses(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    offset = rng.uniform([-0.03, 0.005, 0.3], [0.01, 0.02, 0.45], (n, 3))
    return transform(random_rotation(rng, (n,)), offset)


def test_silhouettes_agree_with_projected_vertices_within_a_pixel(wedge):
    Ts_camera_part = poses(12)
    masks = render_part_views(wedge, Ts_camera_part, OFF_CENTRE, rgb=False).masks
    pixels = OFF_CENTRE.project(transform_points(Ts_camera_part, np.asarray(wedge.mesh.vertices)))
    for mask, p in zip(masks, pixels, strict=True):
        rows, columns = np.nonzero(mask)
        box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        p = np.clip(p, 0, [OFF_CENTRE.width, OFF_CENTRE.height])
        assert np.abs(box - np.concatenate([p.min(axis=0), p.max(axis=0)])).max() < 1.0


def test_silhouettes_are_not_shifted_on_average(wedge):
    # Half a pixel of shift, the classic mistake, would show as a mean of 0.5; rounding has a mean of 0.
    Ts_camera_part = poses(40, seed=1)
    masks = render_part_views(wedge, Ts_camera_part, OFF_CENTRE, rgb=False).masks
    pixels = OFF_CENTRE.project(transform_points(Ts_camera_part, np.asarray(wedge.mesh.vertices)))
    middle = [[(np.flatnonzero(m.any(axis=a))[[0, -1]] + [0, 1]).mean() for a in (0, 1)] for m in masks]
    shift = np.array(middle) - (pixels.min(axis=1) + pixels.max(axis=1)) / 2
    assert np.abs(shift.mean(axis=0)).max() < 0.12


def test_depth_agrees_with_ray_casting(wedge):
    T_camera_part = poses(1, seed=2)
    with PartRenderer(wedge, OFF_CENTRE.height, OFF_CENTRE.width) as renderer:
        depth_m = renderer.render(T_camera_part, OFF_CENTRE, rgb=False).depth_m[0]
        model, data = renderer._renderer.model, renderer._data
    T_part_camera = np.linalg.inv(T_camera_part[0])
    directions = OFF_CENTRE.rays() @ T_part_camera[:3, :3].T
    seen = np.argwhere(depth_m > 0)[::7]
    # The rays are (x, y, 1), so the distance that ray casting counts in ray lengths is depth along the axis.
    cast = [mujoco.mj_ray(model, data, T_part_camera[:3, 3], directions[r, c], None, 1, -1, None) for r, c in seen]
    error = np.abs(np.array(cast) - depth_m[tuple(seen.T)])
    assert len(seen) > 50
    # A pixel centre within rounding of an edge may fall on either side of it.
    assert np.quantile(error, 0.98) < 1e-5


def test_scene_depth_is_metric_and_floor_is_seen_between_the_parts(boxes):
    with SceneRenderer(boxes) as renderer:
        frame = renderer.capture()
    assert frame.depth_m is not None and frame.instances is not None
    np.testing.assert_allclose(frame.depth_m[frame.instances == 0], 0.999, atol=1e-5)
    np.testing.assert_allclose(frame.depth_m[frame.instances == 1], 0.949, atol=1e-5)
    np.testing.assert_allclose(frame.depth_m[frame.instances == -1], 1.49, atol=1e-5)


def test_instances_and_colours_agree_and_collision_geoms_and_sites_are_hidden(boxes):
    with SceneRenderer(boxes) as renderer:
        frame = renderer.capture()
    assert frame.instances is not None
    inner = {k: frame.rgb[frame.instances == k].mean(axis=0) for k in (0, 1)}
    assert inner[0].argmax() == 0 and inner[1].argmax() == 1
    assert set(np.unique(frame.instances)) == {-1, 0, 1}


def test_a_camera_of_the_model_and_the_same_pinhole_see_the_same(boxes):
    with Renderer(boxes.model, CAMERA.height, CAMERA.width) as renderer:
        named = renderer.render(boxes.data, "overhead", depth=True, geoms=True)
        free = renderer.render(boxes.data, Viewpoint(CAMERA, boxes.T_world_camera), depth=True, geoms=True)
    assert named.depth_m is not None and free.depth_m is not None
    assert named.rgb is not None and free.rgb is not None
    np.testing.assert_array_equal(named.geoms, free.geoms)
    np.testing.assert_allclose(named.depth_m, free.depth_m, atol=1e-5)
    assert np.abs(named.rgb.astype(int) - free.rgb).max() <= 2


def test_only_draws_the_named_geoms_and_leaves_the_model_as_it_was(boxes):
    groups = boxes.model.geom_group.copy()
    hidden = boxes.model.geom("visual_0").id
    with Renderer(boxes.model, CAMERA.height, CAMERA.width) as renderer:
        alone = renderer.render(boxes.data, "overhead", geoms=True, only=[hidden]).geoms
    assert alone is not None
    assert set(np.unique(alone)) == {-1, hidden}
    np.testing.assert_array_equal(boxes.model.geom_group, groups)


def test_changes_of_the_model_show(boxes):
    with SceneRenderer(boxes) as renderer:
        before = renderer.capture()
        boxes.model.geom("visual_0").rgba = [0, 0, 1, 1]
        after = renderer.capture()
    assert after.rgb[before.instances == 0].mean(axis=0).argmax() == 2


def test_a_replaced_model_is_followed(boxes):
    with SceneRenderer(boxes) as renderer:
        renderer.capture()
        other = type(boxes)()
        other.model.body("part_00").pos = [0.0, 0.0, 0.2]
        mujoco.mj_forward(other.model, other.data)
        boxes.model, boxes.data = other.model, other.data
        frame = renderer.capture()
    assert frame.depth_m is not None
    np.testing.assert_allclose(frame.depth_m[frame.instances == 0], 0.799, atol=1e-5)


def test_renderers_in_one_process_do_not_disturb_each_other(boxes, wedge):
    with SceneRenderer(boxes) as alone:
        expected = alone.capture()
    first, second = SceneRenderer(boxes), PartRenderer(wedge, 64, 64)
    camera = Pinhole.from_fovy(64, 64, 20.0)
    view = second.render(poses(1), camera)
    first.capture()
    again = second.render(poses(1), camera)
    second.close()
    frame = first.capture()
    first.close()
    np.testing.assert_array_equal(view.rgb, again.rgb)
    np.testing.assert_array_equal(frame.rgb, expected.rgb)
    np.testing.assert_array_equal(frame.depth_m, expected.depth_m)


def test_closing_twice_is_fine_and_rendering_afterwards_is_an_error(boxes):
    renderer = Renderer(boxes.model, 8, 8)
    renderer.render(boxes.data, "overhead")
    renderer.close()
    renderer.close()
    with pytest.raises(RenderingUnavailableError, match="the renderer is closed; make a new one"):
        renderer.render(boxes.data, "overhead")
    scene_renderer = SceneRenderer(boxes)
    scene_renderer.close()
    scene_renderer.close()
    with pytest.raises(RenderingUnavailableError, match="closed; make a new one"):
        scene_renderer.capture()


def test_a_renderer_that_another_thread_collects_says_nothing(wedge, monkeypatch):
    renderer = PartRenderer(wedge, 32, 32)
    renderer.render(poses(1), Pinhole(32, 32, 60.0, 60.0, 16.0, 16.0))
    inner = renderer._renderer
    with monkeypatch.context() as patched:
        patched.setattr(Renderer, "close", lambda self: (_ for _ in ()).throw(RuntimeError("current elsewhere")))
        with pytest.raises(RuntimeError, match="current elsewhere"):
            inner.close()
        # As an exception in a finalizer, it would fail this test.
        inner.__del__()
    renderer.close()


def test_wrong_requests_are_explained(boxes):
    with Renderer(boxes.model, 8, 8) as renderer:
        with pytest.raises(UnknownNameError, match=r"no camera named 'side'. Valid: overhead\."):
            renderer.render(boxes.data, "side")
        with pytest.raises(ConfigError, match=r"fit into the renderer's 8 x 8 px, got 96 x 80; make a larger renderer"):
            renderer.render(boxes.data, Viewpoint(CAMERA, np.eye(4)))
    with pytest.raises(ConfigError, match=r"image width must be between 1 and 8192 px, got 0"):
        Renderer(boxes.model, 8, 0)
    with pytest.raises(ConfigError, match=r"samples must be between 0 and 16, got 99"):
        RenderQuality(samples=99)


def test_part_batches_are_checked(wedge):
    camera = Pinhole.from_fovy(16, 16, 20.0)
    with PartRenderer(wedge, 16, 16) as renderer:
        with pytest.raises(ConfigError, match="one camera for each pose, got 1 cameras for 2 poses"):
            renderer.render(poses(2), [camera])
        with pytest.raises(ConfigError, match=r"one image size, got \[\(8, 16\), \(16, 16\)\]"):
            renderer.render(poses(2), [camera, Pinhole.from_fovy(16, 8, 20.0)])
        behind = np.diag([1.0, 1.0, 1.0, 1.0])[None].copy()
        behind[0, 2, 3] = -0.3
        with pytest.raises(ConfigError, match=r"in front of the camera, got z = -0.3 m in pose 0"):
            renderer.render(behind, camera)
        assert renderer.render(np.zeros((0, 4, 4)), camera).depth_m.shape == (0, 16, 16)
