import json

import numpy as np
import pytest

from simpick.bop import BopDataset, BopInstance, BopWriter
from simpick.errors import ConfigError, OutputError


def test_info_counts_pixels_and_boxes_as_the_toolkit_does(root, frames):
    info = json.loads((root / "test/000004/scene_gt_info.json").read_text())["0"]
    block, _, hidden = info
    depth_m = frames[0].depth_m
    assert (
        block
        == {
            "bbox_obj": [10, 5, 9, 7],  # columns 10 to 19, rows 5 to 12
            "bbox_visib": [10, 9, 9, 3],
            "px_count_all": 80,
            "px_count_valid": int((depth_m[5:13, 10:20] > 0).sum()),
            "px_count_visib": 40,
            "visib_fract": 0.5,
        }
    )
    assert hidden["bbox_obj"] == hidden["bbox_visib"] == [-1, -1, -1, -1]
    assert (hidden["px_count_all"], hidden["px_count_visib"], hidden["visib_fract"]) == (42, 0, 0.0)


def test_what_the_image_cuts_off_counts_as_unseen(tmp_path, parts, frames, instances):
    cut = BopInstance("rod", instances[1].T_camera_part, instances[1].mask, instances[1].mask, silhouette_px=440)
    with BopWriter(tmp_path / "d", parts) as writer:
        writer.add(0, frames[0], [cut])
    assert BopDataset(tmp_path / "d").scene(0).truth(0)[0].visible_fraction == 0.5


def test_targets_count_what_is_visible_to_a_tenth(root):
    targets = [(t.scene_id, t.im_id, t.obj_id, t.inst_count) for t in BopDataset(root).targets()]
    assert targets == [(4, 0, 1, 1), (4, 0, 2, 1), (4, 1, 1, 1), (4, 1, 2, 1)]


def test_a_second_writer_goes_on_where_the_first_ended(root, parts, frames, instances):
    with BopWriter(root, parts) as writer:
        assert writer.add(4, frames[0], instances[:1]) == 2
        assert writer.add(7, frames[0], instances[:1]) == 0
    dataset = BopDataset(root)
    assert dataset.scene_ids == (4, 7) and dataset.scene(4).im_ids == (0, 1, 2)
    assert len(dataset.targets()) == 6


def test_scenes_that_are_there_can_be_refused(root, parts):
    writer = BopWriter(root, parts)
    writer.check_new([0, 1])
    with pytest.raises(OutputError, match=r"has scenes 4 already; choose another folder or other scenes \(seeds\)"):
        writer.check_new([3, 4, 5])


def test_what_a_killed_writer_left_of_an_image_is_replaced(root, parts, frames, instances):
    scene = root / "test/000004"
    cameras = json.loads((scene / "scene_camera.json").read_text())
    del cameras["1"]
    (scene / "scene_camera.json").write_text(json.dumps(cameras))
    with BopWriter(root, parts) as writer:
        assert writer.add(4, frames[0], instances[:1]) == 1
    assert [path.name for path in scene.glob("mask/000001_*.png")] == ["000001_000000.png"]
    assert len(BopDataset(root).scene(4).truth(1)) == 1


def test_the_same_run_writes_the_same_files(tmp_path, parts, frames, instances):
    for name in ("a", "b"):
        with BopWriter(tmp_path / name, parts) as writer:
            writer.add(0, frames[0], instances)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert len(files) == 20
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_a_folder_with_other_content_is_refused(tmp_path, parts):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"is not empty and was not written by simpick; choose another folder"):
        BopWriter(tmp_path, parts)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_other_parts_or_another_order_are_refused(root, parts):
    with pytest.raises(OutputError, match=r"not written by simpick with these parts in this order"):
        BopWriter(root, parts[::-1])


def test_depth_beyond_16_bits_is_refused(tmp_path, parts, frames):
    with (
        BopWriter(tmp_path / "d", parts, depth_scale_mm=0.01) as writer,
        pytest.raises(
            ConfigError, match=r"must be at most 0\.655 m with a depth scale of 0\.01 mm, got 2\.000 m; raise"
        ),
    ):
        writer.add(0, frames[0], [])


def test_an_unknown_part_or_a_mask_of_another_size_is_refused(tmp_path, parts, frames, instances):
    mask = np.zeros((20, 30), bool)
    with BopWriter(tmp_path / "d", parts) as writer:
        with pytest.raises(ConfigError, match=r"part must be one of the writer's \(block, rod\), got 'nut'"):
            writer.add(0, frames[0], [BopInstance("nut", np.eye(4), mask, mask)])
        with pytest.raises(ConfigError, match=r"mask must have the image's size 64 x 48 px, got 30 x 20"):
            writer.add(0, frames[0], [BopInstance("rod", np.eye(4), mask, mask)])


def test_jpeg_and_frames_without_depth_are_written(tmp_path, parts, frames, instances):
    frame = frames[0].__class__(frames[0].rgb, frames[0].camera, frames[0].T_world_camera)
    with BopWriter(tmp_path / "d", parts, color_format="jpg") as writer:
        writer.add(0, frame, instances)
    scene = BopDataset(tmp_path / "d").scene(0)
    assert scene.frame(0).depth_m is None and scene.frame(0).rgb.shape == (48, 64, 3)
    assert (tmp_path / "d/test/000000/rgb/000000.jpg").is_file()
