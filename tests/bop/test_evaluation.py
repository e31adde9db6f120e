"""`simpick evaluate` on data sets, results files and fresh bins."""

import dataclasses
import json
import shutil

import numpy as np
import pytest

from simpick.bop import BopDataset, BopDetection, BopResult, BopTarget, read_detections, read_results, write_results
from simpick.bop.rle import encode_rle
from simpick.cli.evaluate import Evaluate
from simpick.errors import ConfigError, DatasetError, OutputError, SimpickError
from simpick.geometry import box_of_mask, invert, transform, transform_points
from simpick.pose_eval.bop_evaluation import (
    bop_images,
    bop_pose_model,
    estimates_from_results,
    spread_images,
    truth_targets,
    vsd_delta_m,
)
from simpick.pose_eval.pose_evaluation import PoseEvaluator, score_images
from simpick.pose_eval.pose_sources import Answer, FileSource, OracleSource
from simpick.records import Detection, PoseEstimate


def evaluate(**settings) -> Evaluate:
    """Return the command, which by default scores the true poses of perfect detections."""
    return Evaluate(**{"estimator": "oracle", "detections": "perfect", **settings})


def _score(dataset, source, detections=None):
    images = bop_images(dataset, dataset.targets(), detections, depth=False)
    with PoseEvaluator(lambda part: bop_pose_model(dataset, part), vsd=False) as evaluator:
        return score_images(images, source, evaluator)


def _true_results(dataset):
    """The truth as results: the block, the seen rod and the hidden one, in both images."""
    results = []
    for im_id in (0, 1):
        for truth in dataset.scene(4).truth(im_id):
            T_camera_model = truth.T_camera_part @ invert(dataset.models.part(truth.obj_id).T_cad_part)
            results.append(BopResult(4, im_id, truth.obj_id, 1.0 - 0.1 * truth.gt_id, T_camera_model, 0.1))
    return results


def test_the_oracle_scores_full_marks(root):
    evaluation = _score(BopDataset(root), OracleSource())
    assert (evaluation.images, evaluation.detections, evaluation.scores.overall.targets) == (2, 4, 4)
    assert evaluation.scores.overall.ar_mssd == evaluation.scores.overall.ar_mspd == 1.0
    assert list(evaluation.scores.by_part) == ["block", "rod"]
    assert evaluation.scores.overall.ar is None
    assert evaluation.summary.median_translation_mm < 1e-9
    assert evaluation.by_visibility["50-70 %"].count == evaluation.by_visibility["90-100 %"].count == 2


def test_a_results_file_scores_what_is_right_in_it(root, tmp_path):
    dataset = BopDataset(root)
    results = _true_results(dataset)
    # The rods of image 1, four diameters away along the optical axis.
    away = transform(translation=np.array([0.0, 0.0, 0.25]))
    results[4:] = [dataclasses.replace(r, T_camera_model=away @ r.T_camera_model) for r in results[4:]]
    write_results(tmp_path / "mine_tiny-test.csv", results)
    estimates = estimates_from_results(dataset, read_results(tmp_path / "mine_tiny-test.csv"), "mine")
    evaluation = _score(dataset, FileSource(estimates))
    assert evaluation.scores.by_part["block"].ar_mssd == 1.0
    assert evaluation.scores.by_part["rod"].ar_mssd == 0.5
    assert evaluation.scores.overall.ar_mssd == 0.75
    # The rod of image 1 is answered too, and its rotation is right: it is only far away.
    assert evaluation.summary.answered == 4 and evaluation.summary.recall_5_deg == 1.0


def test_images_without_any_estimate_count_as_missed(root):
    evaluation = _score(BopDataset(root), FileSource({}))
    assert evaluation.scores.overall.ar_mssd == 0.0
    assert (evaluation.summary.count, evaluation.summary.answered, evaluation.summary.recall_30_deg) == (4, 0, 0.0)


def test_a_rod_rotated_about_its_axis_is_correct(root):
    dataset = BopDataset(root)

    class Turned(OracleSource):
        def estimate(self, image):
            turn = transform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
            return [dataclasses.replace(e, T_camera_part=e.T_camera_part @ turn) for e in super().estimate(image)]

    evaluation = _score(dataset, Turned())
    assert evaluation.scores.by_part["rod"].ar_mssd == 1.0
    assert evaluation.scores.by_part["block"].ar_mssd < 1.0


def _detection(im_id, obj_id, score, mask):
    return BopDetection(4, im_id, obj_id, score, None, encode_rle(mask), 0.3, "found.json, entry 0")


def test_of_a_detections_file_the_best_are_used_as_many_as_there_are_targets(root, instances):
    dataset = BopDataset(root)
    masks = [instance.mask for instance in instances]
    found = [_detection(0, 2, score, mask) for score, mask in zip((0.2, 0.9, 0.5), masks, strict=True)]
    images = list(bop_images(dataset, dataset.targets(), [*found, _detection(0, 1, 0.1, masks[0])]))
    assert [(d.part, d.score) for d in images[0].detections] == [("rod", 0.9), ("block", 0.1)]
    assert images[0].detection_s == 0.3 and images[1].detections == ()
    with pytest.raises(ConfigError, match=r"the oracle needs detections that name instances: take perfect"):
        OracleSource().prepare(images[0])


def test_of_a_detector_four_times_as_many_are_used_and_the_most_certain_poses_count(root, instances):
    class Eager:
        def detect(self, frame, parts):
            mask = instances[0].mask
            box = np.array([0.0, 0.0, 8.0, 8.0])
            return [Detection(part.name, box, mask, k / 10) for part in parts for k in (9, 8, 7, 6, 5, 4)]

    dataset = BopDataset(root)
    image = next(bop_images(dataset, dataset.targets(), Eager(), depth=False))
    used = [d.score for d in image.detections if d.part == "rod"]
    assert used == [0.9, 0.8, 0.7, 0.6][: 4 * image.inst_counts["rod"]] and len(used) == 4
    # The pose of the last detection is the certain one.
    truth = next(t for t in image.truths if t.part == "rod")
    away = truth.T_camera_part @ transform(translation=np.array([0.0, 0.0, 0.1]))
    poses = [PoseEstimate("rod", away, 0.2, "mine", 0.0), PoseEstimate("rod", truth.T_camera_part, 0.7, "mine", 0.0)]
    evaluation = _score(dataset, FileSource({(4, 0): poses}))
    assert evaluation.summary.median_translation_mm < 1e-6


def test_estimates_of_unnamed_detections_answer_the_nearest_truth(root):
    dataset = BopDataset(root)
    image = next(bop_images(dataset, dataset.targets(), []))
    truth = next(t for t in image.truths if t.part == "rod")
    near = truth.T_camera_part @ transform(translation=np.array([0.0, 0.0, 0.002]))
    source = FileSource({(4, 0): [PoseEstimate("rod", near, 1.0, "mine", 0.0)]})
    evaluation = _score(dataset, source)
    assert evaluation.summary.answered == 1
    assert abs(evaluation.summary.median_translation_mm - 2) < 1e-6


def test_annotations_can_stand_for_the_target_list(root):
    dataset = BopDataset(root)
    assert tuple(truth_targets(dataset)) == dataset.targets()


def test_targets_without_objects_are_refused(root):
    (root / "test_targets_bop24.json").write_text('[{"im_id": 0, "scene_id": 4}]')
    dataset = BopDataset(root)
    with pytest.raises(DatasetError, match=r"these targets name images only; give a list with obj_id and inst_count"):
        next(bop_images(dataset, dataset.targets("test_targets_bop24.json")))


def test_eval_models_of_another_centre_stay_where_they_are(root):
    """An eval model that lost one side has another bounding box; in the model frame its vertices do not move."""
    path = root / "models_eval/obj_000001.ply"
    header, body = path.read_text().split("end_header\n")
    lines = body.splitlines()
    x, *rest = lines[0].split()
    lines[0] = " ".join([repr(float(x) - 20.0), *rest])
    path.write_text(header + "end_header\n" + "\n".join(lines) + "\n")
    dataset = BopDataset(root)
    model = bop_pose_model(dataset, "block")
    assert np.abs(model.T_part_rendered[:3, 3]).max() > 1e-3
    points = transform_points(model.T_part_rendered, np.asarray(model.rendered.mesh.vertices))
    np.testing.assert_allclose(points, model.evaluation.vertices_m, atol=1e-12)
    original = np.asarray(dataset.models.part(1).mesh.vertices)
    gaps = np.linalg.norm(original[:, None] - points[None], axis=-1).min(axis=1)
    assert (gaps < 1e-9).sum() >= len(original) - 1


def test_models_with_holes_have_mass(root):
    path = root / "models/obj_000001.ply"
    text = path.read_text().replace("element face 12", "element face 9")
    path.write_text("\n".join(text.splitlines()[:-3]) + "\n")
    part = BopDataset(root).models.part(1)
    assert not part.mesh.is_watertight and part.mass_kg > 0


def test_vsd_of_an_image_without_depth_is_refused(root):
    dataset = BopDataset(root)
    image = next(bop_images(dataset, dataset.targets(), depth=False))
    with (
        PoseEvaluator(lambda part: bop_pose_model(dataset, part)) as evaluator,
        pytest.raises(ConfigError, match=r"VSD needs depth, and scene 4, image 0 has none; evaluate without VSD"),
    ):
        evaluator.score(Answer(image, [], 0.0))


def test_itodd_has_its_own_visibility_tolerance(root):
    assert vsd_delta_m(BopDataset(root)) == 0.015
    root.rename(root.with_name("itodd"))
    assert vsd_delta_m(BopDataset(root.with_name("itodd"))) == 0.005


def test_the_command_prints_recalls_and_writes_results(root, tmp_path, capsys):
    out = tmp_path / "oracle_tiny-test.csv"
    assert evaluate(dataset=root, vsd=False, results_out=out).run() == 0
    text = capsys.readouterr().out
    assert "oracle on tiny, perfect detections" in text and "100.0" in text and "2 images, 4 detections" in text
    assert len(read_results(out)) == 4
    assert evaluate(dataset=root, vsd=False, results=out, max_images=1).run() == 0
    assert "1 images" in capsys.readouterr().out


def _without_truth(root):
    for name in ("scene_gt.json", "scene_gt_info.json"):
        (root / "test/000004" / name).unlink()
    for folder in ("mask", "mask_visib"):
        shutil.rmtree(root / "test/000004" / folder)


def test_a_data_set_without_truth_gives_results_and_no_table(root, instances, tmp_path, capsys):
    mask = encode_rle(instances[1].mask)
    x0, y0, x1, y1 = 30, 20, 41, 40
    found = [{"scene_id": 4, "image_id": 0, "category_id": k, "bbox": [x0, y0, x1 - x0, y1 - y0]} for k in (2, 77, 78)]
    (tmp_path / "found.json").write_text(json.dumps([f | {"score": 0.5, "segmentation": mask} for f in found]))
    _without_truth(root)
    given = {"dataset": root, "detections": str(tmp_path / "found.json"), "estimator": "retrieval"}
    out = tmp_path / "mine_tiny-test.csv"
    assert evaluate(**given, results_out=out).run() == 0
    text = capsys.readouterr().out
    assert "note: 2 of 3 detections are of unknown objects" in text
    assert "1 estimates in 2 images; tiny has no true poses to compare with" in text.replace("\n", " ")
    (result,) = read_results(out)
    assert (result.scene_id, result.im_id, result.obj_id) == (4, 0, 2)
    _check_as_the_bop_toolkit(out)
    with pytest.raises(ConfigError, match=r"tiny has no true poses \(scene_gt.json\) to score with; write estimates"):
        evaluate(**given).run()
    with pytest.raises(ConfigError, match=r"to score .*mine_tiny-test.csv with; choose a split that has them"):
        evaluate(dataset=root, results=out).run()
    with pytest.raises(ConfigError, match=r"tiny has no annotations .*; give --detections FILE or learned"):
        evaluate(dataset=root, results_out=out).run()


def _check_as_the_bop_toolkit(path):
    """Check a results CSV as ``bop_toolkit_lib.inout.load_bop_results`` (version bop19) and its format check do."""
    lines = path.read_text().splitlines()
    assert lines[0] == "scene_id,im_id,obj_id,score,R,t,time"
    times = {}
    for line in lines[1:]:
        scene_id, im_id, _, score, R, t, time_s = line.split(",")
        assert np.array(list(map(float, R.split()))).reshape(3, 3).shape == (3, 3)
        assert len(list(map(float, t.split()))) == 3 and float(score) == float(score)
        assert times.setdefault((int(scene_id), int(im_id)), float(time_s)) == float(time_s)
    assert path.stem.count("_") == 1 and "-" in path.stem.split("_")[1], "METHOD_DATASET-SPLIT.csv"


def test_results_need_neither_masks_nor_detections(root, tmp_path, capsys):
    write_results(tmp_path / "mine_tiny-test.csv", _true_results(BopDataset(root)))
    for folder in ("mask", "mask_visib"):
        shutil.rmtree(root / "test/000004" / folder)
    assert evaluate(dataset=root, vsd=False, results=tmp_path / "mine_tiny-test.csv").run() == 0
    text = capsys.readouterr().out
    assert "mine_tiny-test on tiny" in text and "AR of 2" in text
    row = next(line for line in text.splitlines() if line.split()[:1] == ["all"])
    assert row.split() == ["all", "4", "100.0", "-", "100.0", "100.0"]
    assert "2 images\n" in text and "per detection" not in text


def test_failed_estimates_are_misses_with_a_note(root, tmp_path, capsys):
    path = tmp_path / "mine_tiny-test.csv"
    write_results(path, _true_results(BopDataset(root)))
    lines = path.read_text().splitlines()
    scene_id, im_id, obj_id, score, _, _, time_s = lines[1].split(",")
    lines[1] = ",".join([scene_id, im_id, obj_id, score, "0 0 0 0 0 0 0 0 0", "0 0 0", time_s])
    path.write_text("\n".join(lines))
    assert evaluate(dataset=root, vsd=False, results=path).run() == 0
    text = capsys.readouterr().out
    assert "note: 1 of 6 estimates failed (t = 0) and count as misses" in text
    row = next(line for line in text.splitlines() if line.split()[:1] == ["block"])
    assert row.split() == ["block", "2", "50.0", "-", "50.0", "50.0"]


def test_results_of_unknown_scenes_are_counted_in_a_note(root, tmp_path, capsys):
    results = _true_results(BopDataset(root))
    path = tmp_path / "mine_tiny-test.csv"
    write_results(path, [*results, dataclasses.replace(results[0], scene_id=99)])
    assert evaluate(dataset=root, vsd=False, results=path).run() == 0
    text = capsys.readouterr().out
    assert "note: 1 of 7 estimates are of scenes or images that the split does not have" in text
    row = next(line for line in text.splitlines() if line.split()[:1] == ["all"])
    assert row.split() == ["all", "4", "100.0", "-", "100.0", "100.0"]


@pytest.mark.parametrize(("kind", "instance"), [("bbox_visib", 0), ("bbox_obj", 0)])
def test_boxes_of_annotations_stand_for_detections(root, instances, kind, instance):
    dataset = BopDataset(root)
    image = next(bop_images(dataset, dataset.targets(), kind))
    own = instances[instance]
    mask = own.mask if kind == "bbox_obj" else own.visible_mask
    detection = next(d for d in image.detections if d.part == "block")
    assert detection.mask is None and detection.box_xyxy_px.tolist() == box_of_mask(mask).tolist()
    assert len(image.detections) == 2, "what is not visible has no box"


def test_some_images_are_spread_over_all():
    targets = [BopTarget(scene_id, im_id, 1, 1) for scene_id in (1, 2) for im_id in range(50)]
    chosen = spread_images(targets, 3)
    assert [(t.scene_id, t.im_id) for t in chosen] == [(1, 0), (2, 0), (2, 49)]
    assert spread_images(targets, None) == spread_images(targets, 1000) == targets


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({}, r"give either --dataset DIR or --bins N"),
        ({"bins": -1}, r"bins must be at least 0, got -1"),
        ({"bins": 2, "split": "val"}, r"split must come with --dataset, got --bins 2"),
        ({"bins": 2, "detections": "d.json"}, r"no file d\.json\. Give a detections file in BOP's format"),
        ({"dataset": "d", "detections": "realistic"}, r"a JSON file in BOP's format, got 'realistic'"),
        ({"dataset": "d", "export": "e"}, r"export must come with --bins; a data set is one already"),
        ({"dataset": "d", "max_images": 0}, r"max_images must be at least 1, got 0"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(settings, text, tmp_path):
    for key in {"dataset", "export"} & settings.keys():
        settings[key] = tmp_path / settings[key]
    with pytest.raises(SimpickError, match=text):
        evaluate(**settings).run()


@pytest.mark.render
def test_fresh_bins_are_evaluated_and_exported_alike(tmp_path, capsys):
    export = tmp_path / "bins"
    assert evaluate(bins=1, count=3, parts=("hex_nut", "l_bracket"), export=export).run() == 0
    fresh = capsys.readouterr().out
    with pytest.raises(OutputError, match=r"has scenes 0 already; choose another folder"):
        evaluate(bins=1, count=3, parts=("hex_nut", "l_bracket"), export=export).run()
    assert len(read_detections(export / "detections_perfect_0-0.json")) == 3
    assert evaluate(dataset=export).run() == 0
    reread = capsys.readouterr().out
    row = next(line for line in fresh.splitlines() if line.split()[:1] == ["all"])
    assert row in reread and row.count("100.0") == 4
    # The file's detections are those that the bin was exported with: an estimator answers both alike.
    file = str(export / "detections_perfect_0-0.json")
    rows = []
    for detections in ("perfect", file):
        settings = {"bins": 1, "count": 3, "parts": ("hex_nut", "l_bracket"), "estimator": "retrieval"}
        assert evaluate(**settings, detections=detections).run() == 0
        rows += [line for line in capsys.readouterr().out.splitlines() if line.split()[:1] == ["all"]]
    assert rows[:2] == rows[2:] and len(rows) == 4
    with pytest.raises(DatasetError, match=r"must hold detections of the bins: scene_id 5 and so on.*holds scenes 0\."):
        evaluate(bins=1, seed=5, count=3, parts=("hex_nut", "l_bracket"), detections=file).run()
    with pytest.raises(DatasetError, match=r"entry 0, key 'category_id': must be from 1 to 1, .* among hex_nut; got 2"):
        evaluate(bins=1, count=3, parts=("hex_nut",), detections=file).run()
    # Raw files, by hand: projected with BOP's K, the vertices' box is the mask's box to within a pixel.
    scene = export / "test/000000"
    camera = json.loads((scene / "scene_camera.json").read_text())["0"]
    dataset = BopDataset(export)
    for truth, info, read in zip(
        json.loads((scene / "scene_gt.json").read_text())["0"],
        json.loads((scene / "scene_gt_info.json").read_text())["0"],
        dataset.scene(0).truth(0),
        strict=True,
    ):
        part = dataset.models.part(read.obj_id)
        vertices_mm = 1000 * transform_points(part.T_cad_part, np.asarray(part.mesh.vertices))
        points = vertices_mm @ np.reshape(truth["cam_R_m2c"], (3, 3)).T + truth["cam_t_m2c"]
        pixels = points @ np.reshape(camera["cam_K"], (3, 3)).T
        pixels = pixels[:, :2] / pixels[:, 2:]
        x, y, width, height = info["bbox_obj"]
        assert (np.ceil(pixels.min(axis=0)) <= [x, y]).all() and (pixels.min(axis=0) > np.array([x, y]) - 1.5).all()
        assert (np.floor(pixels.max(axis=0)) >= [x + width, y + height]).all()
        assert (pixels.max(axis=0) < np.array([x + width, y + height]) + 1.5).all()
