"""Results survive kills, and never mix with those of another configuration."""

import json
from pathlib import Path

import pytest

from simpick.errors import OutputError
from simpick.experiments.result_store import EpisodeResult, ResultStore, read_results
from simpick.records import PickOutcome, PickRecord, PoseError

CONFIG = {"seed": 0, "parts": ["hex_bolt"]}


def make_pick(pick: int, outcome: PickOutcome = PickOutcome.SUCCESS, target: int | None = 3) -> PickRecord:
    return PickRecord(
        pick=pick,
        outcome=outcome,
        cause="delivered",
        target_part="hex_bolt",
        target_instance=target,
        delivered=(target,) if outcome is PickOutcome.SUCCESS and target is not None else (),
        ejected=(),
        remaining=1,
        pose_error=PoseError(1.0, 2.0, 1.5, -1.2, 2.5),
        motion_s=5.0,
        stages=("approach", "lift"),
        peak_force_n=12.5,
        timings_s={"render": 0.1, "detect": 0.01, "estimate": 0.02, "plan": 0.07, "simulate": 1.0},
    )


def make_result(episode: int = 0, *picks: PickRecord, ended: str = "cleared") -> EpisodeResult:
    return EpisodeResult(episode, 10 + episode, ("hex_bolt", "tee"), picks or (make_pick(0),), ended, {"wall": 3.0})


def test_results_come_back_as_they_were(tmp_path: Path) -> None:
    store = ResultStore(tmp_path / "run", CONFIG)
    store.add(make_result(1))
    store.add(make_result(0))
    again = ResultStore(tmp_path / "run", CONFIG)
    assert again.results == (make_result(0), make_result(1))
    assert (0, "") in again and (2, "") not in again


def test_lines_stand_in_episode_order(tmp_path: Path) -> None:
    store = ResultStore(tmp_path, CONFIG)
    for episode in (2, 0, 1):
        store.add(make_result(episode))
    assert [r.episode for r in read_results(tmp_path / "results.jsonl")] == [0, 1, 2]


def test_a_line_of_a_version_without_modes_is_refused(tmp_path: Path) -> None:
    line = make_result().to_json()
    line.pop("mode")
    (tmp_path / "results.jsonl").write_text(json.dumps(line) + "\n")
    with pytest.raises(OutputError, match=r"line 1, is not an episode of this version of simpick \(mode is missing\)"):
        read_results(tmp_path / "results.jsonl")


def test_without_timings_nothing_depends_on_the_clock() -> None:
    line = json.dumps(make_result().to_json(timings=False))
    assert "timings_s" not in line and "simulate" not in line and "motion_s" in line


def test_another_configuration_is_refused(tmp_path: Path) -> None:
    ResultStore(tmp_path, CONFIG)
    with pytest.raises(OutputError, match=r"another configuration: seed \(0 there, 1 now\).*--overwrite"):
        ResultStore(tmp_path, CONFIG | {"seed": 1})


def test_more_episodes_are_added_and_fewer_are_refused(tmp_path: Path) -> None:
    ResultStore(tmp_path, CONFIG | {"episodes": 1}).add(make_result(0))
    assert ResultStore(tmp_path, CONFIG | {"episodes": 3}).results == (make_result(0),)
    assert json.loads((tmp_path / "config.json").read_text())["episodes"] == 3
    with pytest.raises(OutputError, match=r"another configuration: episodes \(3 there, 2 now\)"):
        ResultStore(tmp_path, CONFIG | {"episodes": 2})


@pytest.mark.parametrize("text", ['{"seed": ', "[]"])
def test_a_damaged_configuration_is_named(text: str, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text(text)
    with pytest.raises(OutputError, match=r"config.json does not state a configuration of simpick.*--overwrite"):
        ResultStore(tmp_path, CONFIG)
    assert ResultStore(tmp_path, CONFIG, overwrite=True).results == ()


def test_overwriting_removes_only_results(tmp_path: Path) -> None:
    ResultStore(tmp_path, CONFIG).add(make_result())
    (tmp_path / "notes.txt").write_text("keep me")
    store = ResultStore(tmp_path, CONFIG | {"seed": 1}, overwrite=True)
    assert store.results == ()
    assert read_results(tmp_path / "results.jsonl") == [make_result()], "kept until there are new ones"
    store.add(make_result(3))
    assert read_results(tmp_path / "results.jsonl") == [make_result(3)]
    assert (tmp_path / "notes.txt").read_text() == "keep me"


def test_a_folder_of_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(OutputError, match=r"must be empty or hold earlier results .*, it holds thesis.tex"):
        ResultStore(tmp_path, CONFIG)


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputError, match=r"results cannot be written to .*out: a file is in the way.* with --out"):
        ResultStore(tmp_path / "out", CONFIG)


@pytest.mark.parametrize("torn", [b'{"episode": 1, "se', b"\xff\xfe", b'{"a": "\xc3'])
def test_a_last_line_that_was_cut_off_is_run_again(tmp_path: Path, torn: bytes) -> None:
    ResultStore(tmp_path, CONFIG).add(make_result(0))
    with (tmp_path / "results.jsonl").open("ab") as stream:
        stream.write(torn)
    store = ResultStore(tmp_path, CONFIG)
    assert store.results == (make_result(0),)
    store.add(make_result(1))
    assert read_results(tmp_path / "results.jsonl") == [make_result(0), make_result(1)]


@pytest.mark.parametrize("line", [b"\xff\xfe\n", b"[" * 10**5 + b"\n", b'{"episode": 1' + b"0" * 400 + b"}\n"])
def test_lines_of_no_episode_are_named(tmp_path: Path, line: bytes) -> None:
    ResultStore(tmp_path, CONFIG).add(make_result())
    with (tmp_path / "results.jsonl").open("ab") as stream:
        stream.write(line)
    with pytest.raises(OutputError, match=r"results.jsonl, line 2, is not an episode") as caught:
        ResultStore(tmp_path, CONFIG)
    assert len(str(caught.value)) < 1000


def test_a_broken_line_is_named(tmp_path: Path) -> None:
    ResultStore(tmp_path, CONFIG).add(make_result())
    with (tmp_path / "results.jsonl").open("a") as stream:
        stream.write('{"episode": 1\n')
    with pytest.raises(OutputError, match=r"results.jsonl, line 2, is not an episode"):
        ResultStore(tmp_path, CONFIG)
