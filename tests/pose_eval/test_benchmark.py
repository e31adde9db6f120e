"""The pose benchmark: fixed bins, cached views, figures that count misses, and labels of partial runs."""

import dataclasses
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from simpick.assets import Part, get_part
from simpick.bop import BopDataset, write_detections
from simpick.cli.main import main
from simpick.errors import ConfigError
from simpick.estimators import registry
from simpick.geometry import so3_exp, transform
from simpick.pose_eval.benchmark_bins import MIXED_PARTS, benchmark_bins, fingerprint, load_view, view_path
from simpick.pose_eval.benchmark_gains import gains
from simpick.pose_eval.benchmark_report import best_of_table, title, to_json
from simpick.pose_eval.benchmark_runs import (
    BinFigures,
    BinScorer,
    PoseBenchmarkResult,
    run_pose_benchmark,
    summarize_scores,
)
from simpick.pose_eval.bin_images import view_bin
from simpick.pose_eval.pose_images import PoseImage
from simpick.pose_eval.pose_sources import OracleSource
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis

SIMULATED = ("perfect", "realistic")


def test_there_are_fifty_bins_and_every_five_are_like_the_whole() -> None:
    bins = benchmark_bins()
    assert Counter(bin.kind for bin in bins) == {"mixed": 30, "homogeneous": 20}
    assert len({bin.seed for bin in bins}) == 50
    assert len({bin.config.parts for bin in bins if bin.kind == "homogeneous"}) == 20
    for k in range(0, 50, 5):
        assert sorted(bin.config.count for bin in bins[k : k + 5]) == [12, 12, 30, 40, 50]
    assert benchmark_bins(7) == bins[:7]
    for name in {name for bin in bins for name in bin.config.parts}:
        assert get_part(name).name == name


@pytest.mark.parametrize("count", [0, 51])
def test_a_number_of_bins_that_do_not_exist_is_refused(count: int) -> None:
    with pytest.raises(ConfigError, match=f"bins of the pose benchmark must be between 1 and 50, got {count}"):
        benchmark_bins(count)


@pytest.mark.render
def test_the_cached_view_is_the_fresh_one_to_the_last_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path))
    bin = benchmark_bins(1)[0]
    fresh, _ = view_bin(bin.config, bin.seed)
    made, cached = load_view(bin), load_view(bin)
    assert fingerprint(fresh) == fingerprint(made) == fingerprint(cached)
    assert cached.frame.camera == fresh.frame.camera
    for a, b in zip(cached.truths, fresh.truths, strict=True):
        assert (a.part, a.instance, a.visible_fraction) == (b.part, b.instance, b.visible_fraction)
    for a, b in zip(cached.image("realistic").detections, fresh.image("realistic").detections, strict=True):
        assert (a.part, a.instance, a.score) == (b.part, b.instance, b.score)
        np.testing.assert_array_equal(a.mask, b.mask)
    # A truncated file is replaced.
    whole = view_path(bin).read_bytes()
    view_path(bin).write_bytes(whole[: len(whole) // 2])
    assert fingerprint(load_view(bin)) == fingerprint(fresh)
    assert len(view_path(bin).read_bytes()) == len(whole)


@pytest.mark.render
def test_a_photograph_shows_the_same_parts_to_the_same_camera() -> None:
    (plain,), (photo,) = (benchmark_bins(1, look) for look in ("default", "photo"))
    a, b = load_view(plain), load_view(photo)
    np.testing.assert_array_equal(a.frame.instances, b.frame.instances)
    np.testing.assert_array_equal(a.frame.depth_m, b.frame.depth_m)
    np.testing.assert_array_equal(a.frame.T_world_camera, b.frame.T_world_camera)
    assert a.frame.camera == b.frame.camera
    for one, other in zip(a.truths, b.truths, strict=True):
        np.testing.assert_array_equal(one.T_camera_part, other.T_camera_part)
    assert np.abs(a.frame.rgb.astype(int) - b.frame.rgb).mean() > 20
    # The photograph is noisy: neighbouring pixels differ where the simulator's image is smooth.
    roughness = [np.median(np.abs(np.diff(view.frame.rgb[..., 1].astype(int), axis=1))) for view in (a, b)]
    assert roughness[1] > roughness[0]


class Listening:
    """Answers no detection well, and keeps what it was asked."""

    def __init__(self) -> None:
        self.asked: list[Sequence[Detection]] = []

    def onboard(self, part: Part) -> None:
        pass

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        self.asked.append(detections)
        T = transform(translation=np.array([0.0, 0.0, 0.5]))
        return [PoseEstimate(d.part, T, 0.5, "listening", 0.0, (), d) for d in detections]


@pytest.mark.render
def test_bins_are_written_for_other_detectors_whose_file_is_read(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    listening = Listening()
    monkeypatch.setitem(registry.SHIPPED, "listening", registry.EstimatorSpec(lambda hypotheses, budget: listening))
    export, file = tmp_path / "bins", tmp_path / "theirs.json"
    assert main(["pose-benchmark", "--bins", "1", "--export", str(export)]) == 0
    (bin,) = benchmark_bins(1)
    perfect = load_view(bin).image("perfect").detections
    numbers = {name: obj_id for obj_id, name in zip(BopDataset(export).models.obj_ids, MIXED_PARTS, strict=True)}
    write_detections(file, [(bin.seed, 0, -1.0, perfect)], numbers.__getitem__)
    result = run_pose_benchmark("listening", bins=1, detections=["perfect", str(file)])
    assert [e.summary.answered for e in result.evaluations.values()] == [len(perfect)] * 2
    simulated, read = listening.asked
    for ours, theirs in zip(simulated, read, strict=True):
        assert ours.part == theirs.part and theirs.instance is None
        np.testing.assert_array_equal(ours.mask, theirs.mask)
        np.testing.assert_allclose(ours.box_xyxy_px, theirs.box_xyxy_px)
    empty = tmp_path / "empty.json"
    empty.write_text("[]")
    assert main(["pose-benchmark", "retrieval", "--bins", "1", "--detections", str(empty)]) == 2
    text = f"must hold detections of the bins: scene_id {bin.seed} and so on, a bin's seed, and image_id 0; it holds"
    assert text in " ".join(capsys.readouterr().err.split())


@pytest.mark.render
def test_true_poses_have_no_error_and_misses_count() -> None:
    result = run_pose_benchmark("oracle", bins=2, detections=SIMULATED)
    perfect, realistic = result.evaluations["perfect"], result.evaluations["realistic"]
    assert perfect.summary.count == perfect.summary.answered == realistic.summary.count
    assert perfect.scores.overall.ar == 1 and perfect.summary.recall_5_deg == 1
    assert perfect.summary.median_rotation_deg < 1e-3
    share = realistic.summary.answered / realistic.summary.count
    assert share < 1
    assert realistic.scores.overall.ar == pytest.approx(share) == realistic.summary.recall_30_deg
    assert sum(band.count for band in realistic.by_visibility.values()) == realistic.summary.count
    assert not result.best_of and not result.onboarding_s
    assert title(result).startswith(
        "oracle on the pose benchmark\nonly the first 2 of 50 bins\n2 mixed, 0 homogeneous\nfingerprint "
    )


class SecondGuess(OracleSource):
    """Answers 40 degrees off, with the truth as the second of two hypotheses or more."""

    def __init__(self, offered: int) -> None:
        super().__init__()
        self._offered = offered

    def estimate(self, image: PoseImage) -> list[PoseEstimate]:
        answers = []
        for estimate in super().estimate(image):
            T = estimate.T_camera_part
            wrong = T @ transform(so3_exp(np.radians(40) * np.array([0.6, 0.0, 0.8])))
            hypotheses = (
                PoseHypothesis(wrong, 0.9),
                PoseHypothesis(T, 0.8),
                *[PoseHypothesis(wrong, 0.7)] * (self._offered - 2),
            )
            answers.append(dataclasses.replace(estimate, T_camera_part=wrong, hypotheses=hypotheses))
        return answers


@pytest.mark.render
@pytest.mark.parametrize(("offered", "shown"), [(2, [1, 2]), (5, [1, 5]), (7, [1, 5, 7])])
def test_the_best_of_the_hypotheses_is_reported_up_to_the_number_that_was_made(offered: int, shown: list[int]) -> None:
    (bin,) = benchmark_bins(1)
    with BinScorer(SecondGuess(offered), ["perfect"]) as scorer:
        result = summarize_scores("second", [bin], ["perfect"], [scorer.score(bin)])
    assert list(result.best_of) == [("perfect", k) for k in shown]
    table = best_of_table(result)
    assert table is not None and list(table.columns[1].cells) == [str(k) for k in shown]
    assert result.best_of["perfect", 1] == result.evaluations["perfect"].summary
    assert result.best_of["perfect", 1].recall_5_deg < 0.5
    for k in shown[1:]:
        assert result.best_of["perfect", k].recall_5_deg == 1
        assert result.best_of["perfect", k].median_translation_mm < 1e-3


def result_of(estimator: str, *bins: tuple[int, float]) -> PoseBenchmarkResult:
    """Return a result of these bins' targets and AR."""
    figures = tuple(BinFigures(targets, ar, 0.5 * ar) for targets, ar in bins)
    return PoseBenchmarkResult(estimator, (), "", {}, {"perfect": figures}, {}, 0, {})


def test_a_gain_is_the_difference_of_the_whole_and_its_interval_is_over_bins() -> None:
    before = result_of("a", (10, 0.5), (30, 0.7), (0, 0.0), (20, 0.6))
    after = result_of("b", (10, 0.6), (30, 0.8), (0, 0.0), (20, 0.7))
    (alike,) = gains([before, after])
    assert (alike.estimator, alike.baseline, alike.detections) == ("b", "a", "perfect")
    assert alike.differences["ar"].value == pytest.approx(0.1) and alike.differences["ar"].has_zero_width
    assert alike.differences["ar"].low == pytest.approx(0.1) == alike.differences["ar"].high
    (mixed,) = gains([before, result_of("c", (10, 0.9), (30, 0.7), (0, 0.0), (20, 0.5))])
    assert mixed.differences["ar"].value == pytest.approx((10 * 0.4 - 20 * 0.1) / 60)
    assert mixed.differences["ar"].low < 0 < mixed.differences["ar"].high
    assert mixed.differences["below_5_deg"].value == pytest.approx(mixed.differences["ar"].value / 2)


@pytest.mark.render
def test_bins_weighted_by_targets_make_the_whole() -> None:
    result = run_pose_benchmark("oracle", detections=["realistic"], bins=2)
    targets = np.array([figures.targets for figures in result.by_bin["realistic"]])
    ar = np.array([figures.ar for figures in result.by_bin["realistic"]])
    below = np.array([figures.below_5_deg for figures in result.by_bin["realistic"]])
    whole = result.evaluations["realistic"]
    assert (targets @ ar) / targets.sum() == pytest.approx(whole.scores.overall.ar)
    assert (targets @ below) / targets.sum() == pytest.approx(whole.summary.recall_5_deg)
    assert targets.sum() == whole.summary.count


@pytest.mark.render
def test_the_command_writes_the_figures_that_several_processes_find_too(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert (
        main(
            ["pose-benchmark", "oracle", "--detections", *SIMULATED, "--bins", "2", "--workers", "2", "--out", str(out)]
        )
        == 0
    )
    (written,) = json.loads((out / "yardstick.json").read_text())["results"]
    here = json.loads(
        json.dumps(to_json(run_pose_benchmark("oracle", bins=2, detections=SIMULATED)), allow_nan=True).replace(
            "NaN", "null"
        )
    )
    for figures in (written, here):
        for preset in figures["detections"].values():
            preset.pop("ms_per_detection")
            assert 0 <= preset.pop("waiting_for_a_core") <= 1
    assert written == here
    assert written["whole"] is False and written["detections"]["perfect"]["ar"] == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "only the first 2 of 50 bins" in text and "oracle by visibility, realistic" in text


@pytest.mark.render
def test_figures_are_not_written_over_anything_by_accident(tmp_path: Path, capsys) -> None:
    command = ["pose-benchmark", "oracle", "--bins", "1", "--detections", "perfect", "--out", str(tmp_path / "out")]
    assert main(command) == 0
    before = (tmp_path / "out/yardstick.json").read_text()
    assert main(command) == 2
    assert "yardstick.json exists already. Choose another folder with --out, or --overwrite" in capsys.readouterr().err
    assert (tmp_path / "out/yardstick.json").read_text() == before
    assert main([*command, "--overwrite"]) == 0
    (tmp_path / "notes.txt").write_text("mine")
    assert main([*command[:-1], str(tmp_path / "notes.txt")]) == 2
    assert "results cannot be written to" in capsys.readouterr().err
    assert main([*command[:-1], str(tmp_path), "--overwrite"]) == 2
    assert "earlier results of the same command, it holds notes.txt, out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("telepathy",), "no estimator named 'telepathy'. Valid: coarse, fine, oracle"),
        (("oracle", "--bins", "51"), "bins of the pose benchmark must be between 1 and 50, got 51"),
        (("oracle", "--workers", "0"), "workers must be at least 1, got 0"),
        (("oracle", "--detections", "wild"), "wild"),
        (
            ("retrieval", "--iterations", "2"),
            "iterations and decoder are options of coarse and fine; 'retrieval' has none",
        ),
        (
            ("retrieval", "--decoder", "2"),
            "iterations and decoder are options of coarse and fine; 'retrieval' has none",
        ),
        (("fine", "--decoder", "-1"), "decoder_steps must be at least 0, got -1"),
        (("fine", "--iterations", "0"), "a fine network needs 1 iteration or more, got 0"),
        (("retrieval@none",), "an estimator must be written NAME or NAME@K with K hypotheses"),
    ],
)
def test_bad_input_is_refused_before_anything_is_made(arguments, text, tmp_path: Path, capsys) -> None:
    try:
        code = main(["pose-benchmark", *arguments, "--out", str(tmp_path / "out")])
    except SystemExit as exit:
        code = exit.code
    errors = " ".join(capsys.readouterr().err.replace("│", "").split())
    assert code == 2 and text in errors and not (tmp_path / "out").exists()
