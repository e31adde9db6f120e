"""``simpick run`` end to end: repeatable, resumable, recorded, and clear about bad input."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

from simpick.cli.main import main
from simpick.experiments.config import RunConfig
from simpick.experiments.report.tables import scores_table
from simpick.experiments.result_store import read_results
from simpick.recording.read_back import metrics_from_rrd
from tests.cli.finished_runs import timeless
from tests.experiments.test_result_store import make_result
from tests.recording.commands import is_whole, rerun

pytestmark = pytest.mark.render

TRUE_POSES = RunConfig(estimator="oracle")

SMALL = ("run", "--estimator", "oracle", "--parts", "pipe_tee", "hex_bolt", "--count", "2")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two folders with the same recorded run, each made by a process of its own."""
    folders = [tmp_path_factory.mktemp("runs") / name for name in ("first", "second")]
    for folder in folders:
        command = [sys.executable, "-m", "simpick.cli.main", *SMALL, "--record", "--out", str(folder)]
        subprocess.run(command, check=True, capture_output=True, text=True)
    return folders


def test_the_same_seed_gives_the_same_results_in_another_process(recorded: list[Path]) -> None:
    first, second = (timeless(folder) for folder in recorded)
    assert first == second
    assert len(first) == 1 and len(first[0]["picks"]) >= 2


def test_the_same_seed_gives_the_same_recording_in_another_process(recorded: list[Path]) -> None:
    files = [next(folder.glob("*.rrd")) for folder in recorded]
    for file in files:
        assert is_whole(file)
    comparison = rerun("rrd", "compare", "--unordered", *files)
    assert comparison.returncode == 0, comparison.stdout + comparison.stderr


def test_the_table_can_be_recomputed_from_the_recording(recorded: list[Path]) -> None:
    (result,) = read_results(recorded[0] / "results.jsonl")
    from_recording = metrics_from_rrd(next(recorded[0].glob("*.rrd")))
    without_timings = json.loads(json.dumps(result.to_json(timings=False)["picks"]))
    again = type(result)(0, 0, result.instances, tuple(from_recording), result.ended).to_json(timings=False)["picks"]
    assert json.loads(json.dumps(again)) == without_timings


def test_the_viewer_is_named_with_its_path_only_off_the_path(
    recorded: list[Path], tmp_path: Path, monkeypatch, capsys
) -> None:
    (tmp_path / "rerun").touch()
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    for found, viewer in ((None, tmp_path / "rerun"), ("/bin/rerun", "rerun")):
        monkeypatch.setattr(shutil, "which", lambda _, found=found: found)
        assert main([*SMALL, "--record", "--out", str(recorded[0])]) == 0
        assert f"open one with: {viewer} {recorded[0]}" in capsys.readouterr().out


def test_true_poses_empty_a_small_bin(recorded: list[Path]) -> None:
    (result,) = read_results(recorded[0] / "results.jsonl")
    assert result.ended == "cleared" and result.delivered == 2


def test_a_stopped_run_resumes_and_ends_the_same(recorded: list[Path], tmp_path: Path, capsys) -> None:
    folder = tmp_path / "run"
    arguments = (*SMALL, "--episodes", "2", "--out", str(folder))
    assert main([*arguments]) == 0
    whole = timeless(folder)
    stamp = json.loads((folder / "results.jsonl").read_text().splitlines()[0])["timings_s"]["wall"]
    # As a kill between the two episodes leaves it.
    lines = (folder / "results.jsonl").read_text().splitlines(keepends=True)
    (folder / "results.jsonl").write_text(lines[0])
    assert main([*arguments]) == 0
    assert timeless(folder) == whole
    first = json.loads((folder / "results.jsonl").read_text().splitlines()[0])
    assert first["timings_s"]["wall"] == stamp, "a finished episode is not run again"
    assert "grasp success" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--parts", "hexbolt"), "no part named 'hexbolt'. Valid: bushing, "),
        (("--parts", "hexbolt"), "Did you mean 'hex_bolt'?"),
        (("--parts", "missing/part.stl"), "missing/part.stl"),
        (("--count", "0"), "count must be between 1 and 50, got 0"),
        (("--count", "500"), "count must be between 1 and 50, got 500"),
        (("--robot", "kuka"), "no robot named 'kuka'. Valid: ur5e."),
        (("--estimator", "telepathy"), "no estimator named 'telepathy'. Valid: coarse, fine, oracle"),
        (("--randomization", "wild"), "no randomization preset named 'wild'. Valid: default, none, photo, strong."),
        (("--episodes", "0"), "simpick: episodes must be at least 1, got 0"),
        (("--noise-mm", "-1"), "noise_mm must be at least 0, got -1"),
        (("--bin-mm", "60", "60", "60", "--parts", "connecting_rod"), "connecting_rod"),
        (
            ("--bin-mm", "0.4", "0.3", "0.12"),
            "simpick: bin_mm[0] must be between 50 and 1000, got 0.4 (give millimetres, not metres)",
        ),
        (("--estimator", "retrieval", "--noise-mm", "1"), "simpick: noise_deg and noise_mm are for estimator 'oracle'"),
        (
            ("--estimator", "oracle", "--hypotheses", "4"),
            "simpick: the oracle knows one pose and makes no hypotheses, got hypotheses=4",
        ),
        (("--estimator", "retrieval", "--hypotheses", "0"), "simpick: hypotheses must be at least 1, got 0"),
        (("--workers", "0"), "workers must be at least 1, got 0"),
    ],
)
def test_bad_input_is_rejected_with_its_remedy(arguments, text, tmp_path: Path, capsys) -> None:
    # Settings that are wrong by themselves end in the parser, the others in the command; both end with 2.
    try:
        code = main(["run", "--out", str(tmp_path / "out"), *arguments])
    except SystemExit as exit:
        code = exit.code
    errors = " ".join(capsys.readouterr().err.replace("│", "").split())
    assert code == 2 and text in errors and "Traceback" not in errors
    assert not (tmp_path / "out").exists(), "nothing is written"


def test_results_of_another_configuration_stay(recorded: list[Path], tmp_path: Path, capsys) -> None:
    folder = tmp_path / "run"
    shutil.copytree(recorded[0], folder)
    before = (folder / "results.jsonl").read_text()
    assert main([*SMALL, "--seed", "7", "--out", str(folder)]) == 2
    assert "seed (0 there, 7 now)" in capsys.readouterr().err
    assert (folder / "results.jsonl").read_text() == before


def test_a_mesh_file_is_described_and_may_not_change_between_episodes(tmp_path: Path, capsys) -> None:
    file, run = tmp_path / "brick.stl", ("--estimator", "oracle", "--count", "1", "--out", str(tmp_path / "run"))
    trimesh.creation.box((40, 25, 20)).export(file)
    assert main(["run", "--parts", str(file), *run]) == 0
    printed = capsys.readouterr().out
    assert f"{file}: 40 x 25 x 20 mm and 24.0 g at 1200 kg/m^3" in printed and "simpick parts add" in printed
    trimesh.creation.box((40, 25, 24)).export(file)
    assert main(["run", "--parts", str(file), "--episodes", "2", *run]) == 2
    assert "holds results of another configuration: content_of_parts" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("config", "title"),
    [
        (RunConfig(), "refined, jaw, learned detections"),
        (RunConfig(detections="perfect"), "refined, jaw, perfect detections (simulated, an upper bound)"),
        (RunConfig(detections="box"), "refined, jaw, box detections (simulated)"),
        # True poses belong to instances, which detections found in the image do not name.
        (TRUE_POSES, "oracle (true poses, an upper bound), jaw, perfect detections (simulated, an upper bound)"),
        (
            replace(TRUE_POSES, noise_deg=7.5, noise_mm=2, detections="realistic"),
            "oracle_noise (true poses, 7.5 deg, 2 mm), jaw, realistic detections (simulated)",
        ),
        (
            replace(TRUE_POSES, noise_mm=2, look_closer=True),
            "oracle_noise@2mm+closer (true poses), jaw, perfect detections (simulated, an upper bound)",
        ),
        (RunConfig(estimator="fine", hypotheses=8), "fine@8, jaw, learned detections"),
    ],
)
def test_the_table_names_mode_and_noise(config: RunConfig, title: str) -> None:
    assert scores_table(config, [make_result()]).title == title


def test_missing_recordings_are_reported(recorded: list[Path], tmp_path: Path, capsys) -> None:
    folder = tmp_path / "run"
    shutil.copytree(recorded[0], folder)
    next(folder.glob("*.rrd")).unlink()
    assert main([*SMALL, "--record", "--out", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert "1 episodes were run before without --record; --overwrite" in printed and "rerun" not in printed
