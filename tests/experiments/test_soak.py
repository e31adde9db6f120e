"""Soaks: samples of a process, and the verdict on them."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import pytest

from simpick.errors import OutputError
from simpick.experiments import soak as module
from simpick.experiments.config import RunConfig
from simpick.experiments.soak import EpisodeSample, SoakVerdict, draw_soak, judge_soak, soak
from simpick.records import PickOutcome, PickRecord
from simpick.run_folder import RunFolder

CONFIG = RunConfig(parts=("hex_nut",), count=1, episodes=3, estimator="oracle", detections="perfect")


def samples(count: int = 50, **of_episode: Any) -> list[EpisodeSample]:
    """Samples of a steady process, except for the fields given as functions of the episode."""
    steady = EpisodeSample(0, 400.0, 6, 8, 1.0, 1.0, 4, 4)
    values = [{field: value(k) for field, value in of_episode.items()} for k in range(count)]
    return [dataclasses.replace(steady, episode=k, **changed) for k, changed in enumerate(values)]


def test_a_steady_process_may_run_on() -> None:
    assert judge_soak(samples()) == SoakVerdict(
        "steady",
        (
            "resident memory stays: 400 to 400 MiB (+0.0%)",
            "file descriptors stay: 6 to 6",
            "threads stay: 8 to 8",
        ),
    )


@pytest.mark.parametrize(("mib", "state"), [(2.6, "steady"), (2.7, "failed")])
def test_memory_may_grow_by_a_fifth_after_the_warm_up(mib: float, state: str) -> None:
    # The medians of episodes 10 to 19 and 40 to 49 are 30 episodes apart.
    verdict = judge_soak(samples(memory_mib=lambda k: 400.0 - 14.5 * mib + mib * k))
    assert verdict.state == state
    assert f"({30 * mib / 400:+.1%})" in verdict.reasons[0]


def test_growth_of_the_warm_up_does_not_count() -> None:
    assert judge_soak(samples(memory_mib=lambda k: 100.0 if k < 10 else 400.0)).state == "steady"


@pytest.mark.parametrize(("field", "name"), [("descriptors", "file descriptors"), ("threads", "threads")])
def test_one_more_descriptor_or_thread_is_a_leak(field: str, name: str) -> None:
    verdict = judge_soak(samples(50, **{field: lambda k: 6 + (k >= 30)}))
    assert verdict.state == "failed" and f"{name} grow: 6 to 7" in verdict.reasons


def test_few_episodes_have_no_verdict_unless_one_failed() -> None:
    assert judge_soak(samples(19)) == SoakVerdict("undecided", ("growth needs 20 episodes or more, got 19",))
    verdict = judge_soak(samples(19, fault=lambda k: "Traceback\nValueError: x" if k == 3 else ""))
    assert verdict.state == "failed" and verdict.reasons[0] == "1 of 19 episodes failed: ValueError: x"


def test_one_fault_fails_a_long_soak() -> None:
    assert judge_soak(samples(fault=lambda k: "diverged" if k == 7 else "")).state == "failed"


def test_an_episode_that_raises_is_a_fault_and_the_next_follows(tmp_path: Path, monkeypatch) -> None:
    def run(config: RunConfig, episode: int, folder: Path | None, *, on_pick) -> SimpleNamespace:
        if episode == 1:
            raise RuntimeError("no memory for the template")
        on_pick(PickRecord(PickOutcome.SUCCESS, "", delivered=(0, 2), pick=0, remaining=0))
        return SimpleNamespace(
            ended="simulation_fault" if episode == 2 else "cleared", picks=[SimpleNamespace(cause="c")]
        )

    monkeypatch.setattr(module, "run_recorded_episode", run)
    found = soak(CONFIG, RunFolder(tmp_path, None, config_file="soak.json"))
    assert [sample.fault.splitlines()[-1:] for sample in found] == [
        [],
        ["RuntimeError: no memory for the template"],
        ["c"],
    ]
    assert [(sample.picks, sample.delivered) for sample in found] == [(1, 2), (0, 0), (1, 2)]
    assert all(sample.memory_mib > 50 and sample.descriptors >= 3 and sample.threads >= 1 for sample in found)
    written = json.loads((tmp_path / "soak.json").read_text())
    assert [EpisodeSample(**row) for row in written["episodes"]] == found
    assert written["verdict"]["state"] == "failed" and written["config"]["count"] == 1


def test_no_episode_begins_after_the_time(tmp_path: Path, monkeypatch) -> None:
    now = iter([0.0, 30.0, 61.0])
    monkeypatch.setattr(module.time, "monotonic", lambda: next(now))
    monkeypatch.setattr(module, "run_recorded_episode", lambda *_, on_pick: SimpleNamespace(ended="cleared", picks=[]))
    assert len(soak(CONFIG, RunFolder(tmp_path, None, config_file="soak.json"), minutes=1.0)) == 1


def test_files_of_an_earlier_soak_stay_without_overwrite(tmp_path: Path) -> None:
    (tmp_path / "soak.json").write_text("{}")
    with pytest.raises(OutputError, match=r"soak\.json exists already"):
        RunFolder(tmp_path, None, config_file="soak.json", overwrite=False)


def test_the_plot_marks_faults(tmp_path: Path) -> None:
    images = []
    for fault in ("", "diverged"):
        found = samples(fault=lambda k, fault=fault: fault if k == 7 else "")
        draw_soak(found, judge_soak(found), tmp_path / "soak.png")
        images.append(cv2.imread(str(tmp_path / "soak.png")))
    orange = [(abs(image.astype(int) - (0, 94, 213)).max(2) < 30).sum() for image in images]
    assert orange[0] == 0 < orange[1]
