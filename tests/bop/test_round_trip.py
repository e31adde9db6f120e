"""What `BopWriter` writes, `BopDataset` reads back."""

import json

import numpy as np
import trimesh

from simpick.bop import BopDataset
from simpick.geometry.transforms import invert, transform_points


def test_images_cameras_and_masks_come_back_unchanged(root, frames, instances):
    scene = BopDataset(root).scene(4)
    assert scene.im_ids == (0, 1)
    for im_id, frame in enumerate(frames):
        read = scene.frame(im_id)
        np.testing.assert_array_equal(read.rgb, frame.rgb)
        assert read.camera == frame.camera
        np.testing.assert_allclose(read.T_world_camera, frame.T_world_camera, atol=1e-12)
        for gt_id, instance in enumerate(instances):
            np.testing.assert_array_equal(scene.mask(im_id, gt_id), instance.mask)
            np.testing.assert_array_equal(scene.visible_mask(im_id, gt_id), instance.visible_mask)


def test_depth_comes_back_within_half_a_step_and_without_inventing_readings(root, frames):
    read = BopDataset(root).scene(4).frame(0)
    assert read.depth_m is not None and read.depth_m.dtype == np.float32
    np.testing.assert_allclose(read.depth_m, frames[0].depth_m, atol=0.5e-4 + 1e-6)
    np.testing.assert_array_equal(read.depth_m == 0, frames[0].depth_m == 0)
    assert BopDataset(root).scene(4).frame(0, depth=False).depth_m is None


def test_poses_of_the_surface_come_back_exactly(root, parts, instances):
    dataset = BopDataset(root)
    truths = dataset.scene(4).truth(0)
    assert [truth.part for truth in truths] == ["block", "rod", "rod"]
    for truth, instance in zip(truths, instances, strict=True):
        written = next(part for part in parts if part.name == truth.part)
        read = dataset.models.part(truth.obj_id)
        # The part frames may differ by a turn; where the CAD frame and each vertex stand may not.
        T_camera_cad = truth.T_camera_part @ invert(read.T_cad_part)
        np.testing.assert_allclose(T_camera_cad, instance.T_camera_part @ invert(written.T_cad_part), atol=1e-12)
        vertices = transform_points(truth.T_camera_part, np.asarray(read.mesh.vertices))
        expected = transform_points(instance.T_camera_part, np.asarray(written.mesh.vertices))
        np.testing.assert_allclose(vertices, expected, atol=1e-9)


def test_a_part_whose_cad_frame_is_not_rotated_keeps_its_part_frame(root, parts, instances):
    truth = BopDataset(root).scene(4).truth(0)[1]
    np.testing.assert_allclose(truth.T_camera_part, instances[1].T_camera_part, atol=1e-12)


def test_symmetries_of_the_read_part_map_its_mesh_onto_itself(root, parts):
    dataset = BopDataset(root)
    for obj_id, written in zip(dataset.models.obj_ids, parts, strict=True):
        read = dataset.models.part(obj_id)
        assert len(read.symmetries.discrete) == len(written.symmetries.discrete)
        assert len(read.symmetries.continuous) == len(written.symmetries.continuous)
        vertices = np.asarray(read.mesh.vertices)
        # The rod's tessellation has 32 sides: 32 steps of its continuous symmetry map vertices onto vertices.
        for S in read.symmetries.transforms(32):
            moved = transform_points(S, vertices)
            gaps = np.linalg.norm(moved[:, None] - vertices[None], axis=-1).min(axis=1)
            assert gaps.max() < 1e-9


def test_models_keep_name_diameter_and_colour(root, parts):
    models = BopDataset(root).models
    for obj_id, part in enumerate(parts, start=1):
        read = models.part(obj_id)
        assert read.name == part.name and models.obj_id(part.name) == obj_id
        assert abs(models.diameter_m(obj_id) - part.diameter_m) < 1e-12
        np.testing.assert_allclose(read.material.rgb, part.material.rgb, atol=0.5 / 255)


def test_evaluation_points_hold_the_mesh_and_are_dense(root):
    models = BopDataset(root).models
    part, points = models.part(1), models.eval_points_m(1)
    gaps = np.linalg.norm(np.asarray(part.mesh.vertices)[:, None] - points[None], axis=-1).min(axis=1)
    assert gaps.max() < 1e-9
    assert len(points) > 200
    np.testing.assert_allclose(points.max(axis=0), part.mesh.bounds[1], atol=1e-9)


def test_true_detections_are_the_visible_masks_with_their_boxes(root, instances):
    detections = BopDataset(root).scene(4).detections(0)
    assert [(d.part, d.instance) for d in detections] == [("block", 0), ("rod", 1)]
    np.testing.assert_array_equal(detections[0].mask, instances[0].visible_mask)
    np.testing.assert_array_equal(detections[0].box_xyxy_px, [10, 9, 20, 13])
    assert [d.part for d in BopDataset(root).scene(4).detections(0, min_visible_fraction=0.6)] == ["rod"]


def test_pixel_centres_move_by_half_a_pixel_and_lengths_to_millimetres(root, frames, instances, parts):
    camera = json.loads((root / "test/000004/scene_camera.json").read_text())["0"]
    assert camera["cam_K"] == [80.3, 0.0, 31.7 - 0.5, 0.0, 80.1, 24.9 - 0.5, 0.0, 0.0, 1.0]
    T_camera_world = invert(frames[0].T_world_camera)
    np.testing.assert_allclose(camera["cam_t_w2c"], 1000 * T_camera_world[:3, 3], atol=1e-9)
    truth = json.loads((root / "test/000004/scene_gt.json").read_text())["0"][1]
    # The rod's CAD origin is at (0, 0.02, -0.005) m in its part frame.
    origin = instances[1].T_camera_part @ [0.0, 0.02, -0.005, 1.0]
    np.testing.assert_allclose(truth["cam_t_m2c"], 1000 * origin[:3], atol=1e-9)


def test_a_vertex_that_no_face_uses_moves_no_part_frame(root):
    before = BopDataset(root).models.part(1)
    file = root / "models/obj_000001.ply"
    mesh = trimesh.load_mesh(file, process=False)
    stray = trimesh.Trimesh([*mesh.vertices, mesh.vertices.max(axis=0) + 5], mesh.faces, process=False)
    stray.export(file)
    after = BopDataset(root).models.part(1)
    assert len(after.mesh.vertices) == len(before.mesh.vertices) + 1
    np.testing.assert_allclose(after.T_cad_part, before.T_cad_part, atol=1e-9)
