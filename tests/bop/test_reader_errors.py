"""Bad data sets: each error names the file, line or key, and says what to do."""

import json
import re

import cv2
import numpy as np
import pytest

from simpick.bop import BopDataset
from simpick.errors import DatasetError


def _edit(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def _refuses(pattern):
    return pytest.raises(DatasetError, match=re.compile(pattern, re.DOTALL))


def test_no_folder(tmp_path):
    with _refuses(r"no folder .*nowhere\. Give the folder of a BOP data set"):
        BopDataset(tmp_path / "nowhere")


def test_no_such_split(root):
    with _refuses(r"has no split 'val', that is no folder val/ with scenes such as 000001\. Splits: test\."):
        BopDataset(root, "val")


def test_no_such_scene(root):
    with _refuses(r"has no scene 5 \(000005\)\. Scenes: 4\."):
        BopDataset(root).scene(5)


def test_missing_scene_camera(root):
    (root / "test/000004/scene_camera.json").unlink()
    with _refuses(r"no file .*scene_camera\.json, nor scene_camera_<camera>\.json\. Each scene needs one; fetch"):
        BopDataset(root)


def test_missing_truth(root):
    (root / "test/000004/scene_gt.json").unlink()
    with _refuses(
        r"no file .*scene_gt\.json\. Test splits of some data sets have no public annotations; choose another"
    ):
        BopDataset(root).scene(4).truth(0)


def test_missing_models_info(root):
    (root / "models/models_info.json").unlink()
    with _refuses(r"no file .*models/models_info\.json\. It comes with the data set's models; fetch them"):
        _ = BopDataset(root).models.obj_ids


def test_missing_models(root):
    for name in ("models", "models_eval"):
        (root / name).rename(root / f"old_{name}")
    with _refuses(r"has no folder models\. Model folders: none\. Fetch the data set's models archive"):
        BopDataset(root)


def test_truncated_json(root):
    path = root / "test/000004/scene_gt.json"
    path.write_text(path.read_text()[:100])
    with _refuses(
        r"scene_gt\.json, line 2, column \d+: not JSON \(.*\)\. The file may be truncated: fetch or write it again"
    ):
        BopDataset(root).scene(4).truth(0)


def test_wrong_frame_id(root):
    with _refuses(r"scene_camera\.json: has no image 9\. Images: 0, 1\. Check the frame's id\."):
        BopDataset(root).scene(4).frame(9)


def test_truth_without_the_frame(root):
    _edit(root / "test/000004/scene_gt.json", lambda gt: gt.pop("1"))
    with _refuses(
        r"scene_gt\.json, image 1: no entry for this image, although scene_camera has one; write an empty list"
    ):
        BopDataset(root).scene(4).truth(1)


def test_listed_image_that_is_not_there(root):
    (root / "test/000004/rgb/000001.png").unlink()
    with _refuses(r"no image 000001 \(png, jpg or tif\) in rgb or gray, although scene_camera\.json lists it"):
        BopDataset(root).scene(4).frame(1)


def test_targets_of_another_split(root):
    (root / "test_targets_bop19.json").write_text('[{"im_id": 0, "inst_count": 1, "obj_id": 1, "scene_id": 12}]')
    with _refuses(r"names scene 12, which split 'test' does not have\. Choose the split"):
        BopDataset(root).targets()


def test_target_without_an_image(root):
    (root / "test_targets_bop19.json").write_text('[{"obj_id": 1, "scene_id": 4}]')
    with _refuses(r"test_targets_bop19\.json, entry 0, key 'im_id': must be a whole number, got None"):
        BopDataset(root).targets()


@pytest.mark.parametrize("factor", [0.5, 2.0, 4.0])
def test_images_resized_without_their_K(root, factor):
    path = root / "test/000004/rgb/000000.png"
    image = cv2.imread(str(path))
    assert image is not None
    cv2.imwrite(str(path), cv2.resize(image, None, fx=factor, fy=factor))
    size = f"{round(64 * factor)} x {round(48 * factor)}"
    expected = rf"image 0: cam_K has its principal point at \(31\.2, 24\.4\) px, the image {size} px: .* scale fx, fy"
    with _refuses(expected):
        BopDataset(root).scene(4).frame(0)


def test_stated_size_that_is_not_the_image_s(root):
    _edit(root / "test/000004/scene_camera.json", lambda c: c["0"].update(width=1280, height=960))
    with _refuses(r"image 0: states an image of 1280 x 960 px, but the image has 64 x 48; scale cam_K"):
        BopDataset(root).scene(4).frame(0)


def test_K_with_eight_numbers(root):
    _edit(root / "test/000004/scene_camera.json", lambda c: c["0"].update(cam_K=[1.0] * 8))
    with _refuses(r"scene_camera\.json, image 0, key 'cam_K': expected 9 numbers, got 8"):
        BopDataset(root).scene(4).frame(0)


def test_K_by_columns(root):
    _edit(root / "test/000004/scene_camera.json", lambda c: c["0"].update(cam_K=[80, 0, 0, 0, 80, 0, 31, 24, 1]))
    with _refuses(r"image 0: cam_K must be \[fx, 0, cx, 0, fy, cy, 0, 0, 1\] with positive fx and fy, got \[80"):
        BopDataset(root).scene(4).frame(0)


def test_fisheye_cameras(root):
    def swap(cameras):
        del cameras["0"]["cam_K"]
        cameras["0"]["cam_model"] = {"projection_model_type": "CameraModelType.FISHEYE624"}

    _edit(root / "test/000004/scene_camera.json", swap)
    with _refuses(r"has a 'cam_model' of type CameraModelType\.FISHEYE624 instead of 'cam_K'\. .*undistort the images"):
        BopDataset(root).scene(4).frame(0)


def test_missing_key(root):
    _edit(root / "test/000004/scene_gt.json", lambda gt: gt["0"][1].pop("cam_t_m2c"))
    with _refuses(r"scene_gt\.json, image 0, instance 1: has no key 'cam_t_m2c', only cam_R_m2c, obj_id"):
        BopDataset(root).scene(4).truth(0)


def test_rotation_that_is_none(root):
    _edit(root / "test/000004/scene_gt.json", lambda gt: gt["0"][0].update(cam_R_m2c=[1, 0, 0, 0, 1, 0, 0, 0, -1]))
    with _refuses(r"instance 0, key 'cam_R_m2c' must be a rotation matrix, row by row, got .*check the order"):
        BopDataset(root).scene(4).truth(0)


def test_translation_in_metres(root):
    _edit(root / "test/000004/scene_gt.json", lambda gt: gt["0"][0].update(cam_t_m2c=[0.0, 0.0, 0.6]))
    with _refuses(
        r"key 'cam_t_m2c' is 0\.6 long; BOP's translations are in millimetres, .*Multiply the translations by 1000"
    ):
        BopDataset(root).scene(4).truth(0)


def test_info_that_lists_other_instances(root):
    _edit(root / "test/000004/scene_gt_info.json", lambda info: info["0"].pop())
    with _refuses(
        r"scene_gt_info\.json, image 0: has 2 entries, but scene_gt has 3; the two must list the same instances"
    ):
        BopDataset(root).scene(4).truth(0)


def test_mesh_absent_for_an_object(root):
    (root / "models/obj_000002.ply").unlink()
    with _refuses(
        r"no mesh .*models/obj_000002\.ply, though .* name this object\. Meshes there: obj_000001\.ply\. Fetch"
    ):
        BopDataset(root).models.part(2)


def test_object_that_models_info_does_not_list(root):
    _edit(root / "test/000004/scene_gt.json", lambda gt: gt["0"][0].update(obj_id=7))
    with _refuses(r"models_info\.json: has no key 7, which the data set's images or results name\. Objects: 1, 2"):
        BopDataset(root).scene(4).truth(0)


def _scale_mesh(path, factor):
    header, body = path.read_text().split("end_header\n")
    match = re.search(r"element vertex (\d+)", header)
    assert match is not None
    count = int(match[1])
    lines = body.splitlines()
    for k in range(count):
        values = lines[k].split()
        lines[k] = " ".join([repr(float(v) * factor) for v in values[:3]] + values[3:])
    path.write_text(header + "end_header\n" + "\n".join(lines) + "\n")


def test_mesh_in_metres_but_info_in_millimetres(root):
    _scale_mesh(root / "models/obj_000002.ply", 0.001)
    with _refuses(
        r"obj_000002\.ply: the mesh's diameter is 0\.06 to 0\.06633 .* but models_info\.json says 63\.25 mm; .*1000"
    ):
        BopDataset(root).models.part(2)


def test_mesh_and_info_in_metres(root):
    _scale_mesh(root / "models/obj_000002.ply", 0.001)
    _edit(root / "models/models_info.json", lambda info: info["2"].update(diameter=0.06325))
    with _refuses(r"obj_000002\.ply: the mesh spans 0\.06 mm, which is not the size of a part .*multiply the vertices"):
        BopDataset(root).models.part(2)


def test_mesh_that_is_no_mesh(root):
    (root / "models/obj_000001.ply").write_text("ply\nformat ascii 1.0\n")
    with _refuses(r"obj_000001\.ply: not a readable PLY mesh \(.*\); fetch it again"):
        BopDataset(root).models.part(1)


def test_symmetry_with_too_few_numbers(root):
    _edit(root / "models/models_info.json", lambda info: info["1"].update(symmetries_discrete=[[1.0] * 9]))
    with _refuses(r"models_info\.json, object 1: symmetries_discrete\[0\]: expected 16 numbers, got 9"):
        BopDataset(root).models.part(1)


@pytest.mark.parametrize("name", ["rgb/000000.png", "depth/000000.png"])
@pytest.mark.parametrize("share", [0.5, 0.99])
def test_truncated_png(root, name, share):
    path = root / "test/000004" / name
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with _refuses(rf"{name}: the PNG is truncated after \d+ bytes; fetch or write it again"):
        BopDataset(root).scene(4).frame(0)


def test_truncated_jpeg(root, frames):
    path = root / "test/000004/rgb/000000.jpg"
    cv2.imwrite(str(path), frames[0].rgb)
    path.write_bytes(path.read_bytes()[:-800])
    path.with_suffix(".png").unlink()
    with _refuses(r"000000\.jpg: the JPEG is truncated after \d+ bytes"):
        BopDataset(root).scene(4).frame(0)


def test_file_that_is_no_image(root):
    (root / "test/000004/rgb/000000.png").write_bytes(b"<html>404</html>")
    with _refuses(r"000000\.png: not a readable PNG, JPEG or TIFF image \(16 bytes\)"):
        BopDataset(root).scene(4).frame(0)


def test_colour_picture_of_depth(root, frames):
    cv2.imwrite(str(root / "test/000004/depth/000000.png"), frames[0].rgb)
    with _refuses(r"depth/000000\.png: a depth image must have one channel, has 3; is it a visualization of depth\?"):
        BopDataset(root).scene(4).frame(0)


def test_depth_and_masks_of_another_size(root):
    scene = root / "test/000004"
    cv2.imwrite(str(scene / "depth/000000.png"), np.ones((24, 32), np.uint16))
    cv2.imwrite(str(scene / "mask_visib/000001_000000.png"), np.ones((24, 32), np.uint8))
    with _refuses(r"depth/000000\.png: has 32 x 24 px, but the colour image has 64 x 48; use images that are aligned"):
        BopDataset(root).scene(4).frame(0)
    with _refuses(r"mask_visib/000001_000000\.png: has 32 x 24 px, but the colour image has 64 x 48"):
        BopDataset(root).scene(4).visible_mask(1, 0)


def test_missing_mask(root):
    (root / "test/000004/mask_visib/000000_000001.png").unlink()
    with _refuses(
        r"no mask .*mask_visib/000000_000001\.png\. Masks are optional in BOP: fetch .* detections as a JSON file"
    ):
        BopDataset(root).scene(4).visible_mask(0, 1)
