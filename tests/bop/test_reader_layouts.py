"""The layouts and names that BOP's data sets have, made by renaming what simpick writes."""

import json

import cv2
import numpy as np
import pytest

from simpick.bop import BopDataset
from simpick.errors import DatasetError


def _rename_camera(scene, suffix, color):
    for name in ("scene_camera", "scene_gt", "scene_gt_info"):
        (scene / f"{name}.json").rename(scene / f"{name}_{suffix}.json")
    for name in ("depth", "mask", "mask_visib"):
        (scene / name).rename(scene / f"{name}_{suffix}")
    (scene / "rgb").rename(scene / color)


@pytest.mark.parametrize("color", ["rgb_cam1", "gray_cam1", "cam1"])
def test_sensor_suffixes_are_read(root, frames, instances, color):
    _rename_camera(root / "test/000004", "cam1", color)
    dataset = BopDataset(root)
    assert dataset.camera == "cam1"
    scene = dataset.scene(4)
    np.testing.assert_array_equal(scene.frame(1).rgb, frames[1].rgb)
    assert scene.frame(1).depth_m is not None
    np.testing.assert_array_equal(scene.visible_mask(1, 0), instances[0].visible_mask)
    assert len(scene.truth(1)) == 3


def test_with_several_cameras_one_must_be_chosen(root):
    scene = root / "test/000004"
    content = (scene / "scene_camera.json").read_text()
    _rename_camera(scene, "cam1", "rgb_cam1")
    (scene / "scene_camera_photoneo.json").write_text(content)
    with pytest.raises(DatasetError, match=r"has several cameras\. Choose one with camera: cam1, photoneo\."):
        BopDataset(root)
    assert BopDataset(root, camera="cam1").scene(4).frame(0).rgb.shape == (48, 64, 3)
    with pytest.raises(DatasetError, match=r"has no camera 'cam9'\. Choose one"):
        BopDataset(root, camera="cam9")


def test_grey_tiff_images_and_depth_are_read(root, frames):
    scene = root / "test/000004"
    grey = frames[0].rgb[..., 1]
    (scene / "gray").mkdir()
    cv2.imwrite(str(scene / "gray/000000.tif"), grey)
    depth = cv2.imread(str(scene / "depth/000000.png"), cv2.IMREAD_UNCHANGED)
    assert depth is not None
    cv2.imwrite(str(scene / "depth/000000.tif"), depth)
    for old in ("rgb/000000.png", "depth/000000.png"):
        (scene / old).unlink()
    frame = BopDataset(root).scene(4).frame(0)
    np.testing.assert_array_equal(frame.rgb, np.repeat(grey[..., None], 3, axis=2))
    assert frame.depth_m is not None and frames[0].depth_m is not None
    np.testing.assert_allclose(frame.depth_m, frames[0].depth_m, atol=1e-4)


def test_depth_scale_of_each_image_is_honoured(root):
    before = BopDataset(root).scene(4).frame(0).depth_m
    path = root / "test/000004/scene_camera.json"
    cameras = json.loads(path.read_text())
    cameras["0"]["depth_scale"] = 1.0
    path.write_text(json.dumps(cameras))
    after = BopDataset(root).scene(4).frame(0).depth_m
    assert before is not None and after is not None
    np.testing.assert_allclose(after, 10 * before, rtol=1e-6)


def test_the_camera_pose_may_have_short_names_or_none(root, frames):
    path = root / "test/000004/scene_camera.json"
    cameras = json.loads(path.read_text())
    cameras["0"]["R_w2c"], cameras["0"]["t_w2c"] = cameras["0"].pop("cam_R_w2c"), cameras["0"].pop("cam_t_w2c")
    del cameras["1"]["cam_R_w2c"], cameras["1"]["cam_t_w2c"]
    path.write_text(json.dumps(cameras))
    scene = BopDataset(root).scene(4)
    np.testing.assert_allclose(scene.frame(0).T_world_camera, frames[0].T_world_camera, atol=1e-12)
    np.testing.assert_array_equal(scene.frame(1).T_world_camera, np.eye(4))


def test_one_split_and_other_model_folders_are_found(root):
    (root / "test").rename(root / "val_primesense")
    (root / "models").rename(root / "models_cad")
    dataset = BopDataset(root)
    assert dataset.split == "val_primesense" and dataset.models.part(1).name == "block"


def test_models_without_names_are_called_by_their_id(root):
    for folder in ("models", "models_eval"):
        path = root / folder / "models_info.json"
        info = json.loads(path.read_text())
        for entry in info.values():
            del entry["name"]
        path.write_text(json.dumps(info))
    models = BopDataset(root).models
    assert models.part(2).name == "obj_000002" and models.obj_id("obj_000002") == 2


def test_scenes_without_info_have_no_visible_fraction(root):
    (root / "test/000004/scene_gt_info.json").unlink()
    assert [truth.visible_fraction for truth in BopDataset(root).scene(4).truth(0)] == [None] * 3


def test_targets_of_the_detection_task_name_images_only(root):
    (root / "test_targets_bop24.json").write_text('[{"im_id": 0, "scene_id": 4}, {"im_ids": [0, 1], "scene_id": 4}]')
    targets = BopDataset(root).targets("test_targets_bop24.json")
    assert [(t.im_id, t.obj_id, t.inst_count) for t in targets] == [(0, None, None), (0, None, None), (1, None, None)]


def test_nothing_is_read_before_it_is_asked_for(root):
    for path in (*root.glob("models/*"), *root.glob("test/*/rgb/*"), *root.glob("test/*/scene_gt.json")):
        path.write_bytes(b"broken")
    assert BopDataset(root).scene(4).im_ids == (0, 1)
