"""``simpick compare`` end to end on the smallest bins: paired, resumable, reported, clear about bad input."""

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simpick.cli.main import main
from simpick.errors import OutputError, SimpickError
from simpick.estimators import registry
from simpick.experiments import comparison, result_store
from simpick.experiments.result_store import read_results
from tests.cli.finished_runs import timeless

pytestmark = pytest.mark.render

SMALL = ("--parts", "pipe_tee", "hex_bolt", "--count", "2")
MODES = ("compare", "oracle", "oracle_noise")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three bins, two modes, recorded, by a process that is killed half-way and then by another."""
    folder = tmp_path_factory.mktemp("compare") / "out"
    command = [sys.executable, "-m", "simpick.cli.main", *MODES, *SMALL, "--episodes", "3", "--record"]
    process = subprocess.Popen([*command, "--out", str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    results = folder / "results.jsonl"
    while process.poll() is None and not (results.exists() and len(results.read_text().splitlines()) >= 3):
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    finished = results.read_text().splitlines()
    assert 3 <= len(finished) < 6, "the first process was to be killed half-way"
    assert main([*MODES, *SMALL, "--episodes", "3", "--record", "--out", str(folder)]) == 0
    assert results.read_text().splitlines()[:2] == finished[:2], "finished episodes are not run again"
    return folder


def test_a_killed_comparison_ends_as_one_that_was_not(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    # Fewer bins first and then more, by workers of their own.
    assert main([*MODES, *SMALL, "--episodes", "3", "--workers", "2", "--out", str(folder)]) == 0
    assert timeless(folder) == timeless(whole)


def test_every_mode_picks_the_same_bins(whole: Path) -> None:
    bins = {(r.episode, r.mode): (r.seed, r.instances) for r in read_results(whole / "results.jsonl")}
    assert set(bins) == {(k, mode) for k in range(3) for mode in ("oracle", "oracle_noise")}
    assert all(bins[k, "oracle"] == bins[k, "oracle_noise"] for k in range(3))


def test_the_report_needs_nothing_else(whole: Path) -> None:
    html = (whole / "report.html").read_text()
    assert not re.search(
        r"<script|<link|<img|@import|url\(\s*['\"]?http|(?:src|href)\s*=\s*['\"]\s*(?:https?:)?//", html
    )
    assert html.count("<svg") == 5 == len(list((whole / "plots").glob("*.svg")))
    assert "oracle_noise" in html and "3 paired bins of 2" in html and "3 bins are few" in html
    assert "$" not in re.sub(r"<svg.*?</svg>", "", html, flags=re.S), "every placeholder is filled"
    links = re.findall(r'<a href="([^"]+)"', html)
    assert len(links) == 6 and all((whole / link).is_file() for link in links)
    assert "rerun oracle_jaw_seed0000.rrd oracle_noise_jaw_seed0000.rrd" in html
    assert all(f"\nrerun {link}\n" in html.replace("<pre>", "\n").replace("</pre>", "\n") for link in links)


def test_the_report_of_a_folder_that_was_moved_still_leads_to_its_recordings(whole: Path, tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere" / "renamed"
    shutil.copytree(whole, moved)
    html = (moved / "report.html").read_text()
    assert str(whole) not in html
    assert all((moved / link).is_file() for link in re.findall(r'<a href="([^"]+)"', html))
    assert main([*MODES, *SMALL, "--episodes", "3", "--record", "--out", str(moved)]) == 0
    assert (moved / "report.html").read_text() == html


def test_more_bins_and_modes_are_added(whole: Path, tmp_path: Path, capsys) -> None:
    folder = tmp_path / "out"
    assert main(["compare", "oracle", *SMALL, "--episodes", "1", "--out", str(folder)]) == 0
    stamp = read_results(folder / "results.jsonl")[0].timings_s
    assert main([*MODES, *SMALL, "--episodes", "2", "--out", str(folder)]) == 0
    results = read_results(folder / "results.jsonl")
    assert len(results) == 4 and results[0].timings_s == stamp
    printed = capsys.readouterr().out
    assert printed.startswith("comparing oracle on 1 bin: ") and "comparing oracle, oracle_noise on 2 bins: " in printed
    assert "oracle_noise" in printed and "failed picks in the same bins, by cause" in printed


def test_wrong_modes_are_reported_all_at_once(tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    def without_weights(hypotheses, budget):
        raise SimpickError("the weights of 'bare' are missing: train them with simpick train")

    monkeypatch.setitem(registry.SHIPPED, "bare", registry.EstimatorSpec(without_weights))
    out = tmp_path / "out"
    modes = ("oracle", "telepathy", "oracle", "retrievel", "retrieval@0", "oracle@4", "bare")
    assert main(["compare", *modes, "--out", str(out)]) == 2
    errors = capsys.readouterr().err
    for text in (
        "no mode named 'telepathy'. Valid: bare, coarse, fine, oracle, oracle_noise, refined, retrieval",
        "'oracle' is named twice",
        "Did you mean 'retrieval'?",
        "an estimator must be written NAME or NAME@K with K hypotheses, 1 or more, such as retrieval@8; got "
        "'retrieval@0'",
        "oracle knows one pose and makes no hypotheses, got 'oracle@4'; leave out @4",
        "the weights of 'bare' are missing: train them with simpick train",
    ):
        assert text in errors
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--noise-mm", "0", "--noise-deg", "0"), "noise_deg and noise_mm must not both be 0"),
        (("--workers", "0"), "workers must be at least 1, got 0"),
        (("--workers", "2", "--ray", "local"), "workers are for this machine, a Ray cluster has its own"),
        (("--parts", "hexbolt"), "no part named 'hexbolt'"),
        (("--count", "0"), "count must be between 1 and 50, got 0"),
    ],
)
def test_bad_settings_are_refused(arguments, text, tmp_path: Path, capsys) -> None:
    assert main([*MODES, *arguments, "--out", str(tmp_path / "out")]) == 2
    assert text in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_other_folders_are_left_alone(whole: Path, tmp_path: Path, capsys) -> None:
    before = (whole / "results.jsonl").read_text()
    assert main([*MODES, *SMALL, "--episodes", "3", "--noise-mm", "2", "--out", str(whole)]) == 2
    assert "another configuration: noise_mm (5.0 there, 2.0 now)" in capsys.readouterr().err
    assert (whole / "results.jsonl").read_text() == before
    (tmp_path / "thesis.tex").write_text("precious")
    assert main([*MODES, *SMALL, "--out", str(tmp_path)]) == 2
    assert "must be empty or hold earlier results of the same command, it holds thesis.tex" in capsys.readouterr().err


def test_a_full_disk_keeps_what_is_finished(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = result_store.ResultStore(tmp_path / "out", {"episodes": 3})
    first, second, *_ = read_results(whole / "results.jsonl")
    store.add(first)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match=r"No space left on device\. What was finished before is kept"):
        store.add(second)
    assert second.key not in store
    assert read_results(tmp_path / "out" / "results.jsonl") == [first]
    assert json.loads((tmp_path / "out" / "config.json").read_text()) == {"episodes": 3}


FULL_DISK = """
import resource, sys
from simpick.cli.main import main
from simpick.experiments.result_store import ResultStore

add = ResultStore.add

def last(store, result):
    add(store, result)
    if len(store.results) == 1:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, resource.RLIM_INFINITY))

ResultStore.add = last
sys.exit(main(sys.argv[1:]))
"""


def test_a_disk_that_is_full_while_recording_ends_the_run_which_resumes_later(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    command = ["compare", "oracle", *SMALL, "--episodes", "2", "--record", "--out", str(folder)]
    # A limit on the size of files stands for the full disk; rerun alone would wait for its writer for ever.
    run = subprocess.run([sys.executable, "-c", FULL_DISK, *command], capture_output=True, text=True, timeout=100)
    assert run.returncode == 2 and "Traceback" not in run.stderr
    assert "oracle_jaw_seed0001.rrd: File too large. What was finished before is kept: make room" in run.stderr
    assert len(timeless(folder)) == 1 and "partial report" in run.stdout
    assert main(command) == 0
    assert timeless(folder) == [line for line in timeless(whole) if line["mode"] == "oracle"][:2]
    assert {file.name for file in folder.glob("*.rrd*")} == {f"oracle_jaw_seed000{k}.rrd" for k in range(2)}


def test_a_run_that_stops_leaves_a_partial_report(
    whole: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("compare.json", "results.jsonl"):
        shutil.copy(whole / name, folder / name)

    def stopped(*arguments: object, **settings: object) -> None:
        raise SimpickError("a worker process was killed")

    monkeypatch.setattr(comparison, "run_jobs", stopped)
    assert main([*MODES, *SMALL, "--episodes", "4", "--out", str(folder)]) == 2
    printed = capsys.readouterr()
    assert "a worker process was killed" in printed.err and "partial report:" in printed.out
    assert "Partial: 1 of 4 bins are left out" in (folder / "report.html").read_text()


def test_ray_runs_the_same_episodes(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("ray")
    # In a process of its own, for Ray warns of things that are errors in tests.
    command = [
        sys.executable,
        "-m",
        "simpick.cli.main",
        *MODES,
        *SMALL,
        "--episodes",
        "2",
        "--record",
        "--ray",
        "local",
    ]
    run = subprocess.run([*command, "--out", str(tmp_path / "out")], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert timeless(tmp_path / "out") == timeless(whole)[:4]
    assert len(list((tmp_path / "out").glob("*.rrd"))) == 4


def test_ray_that_is_missing_is_named(tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    assert main([*MODES, *SMALL, "--ray", "auto", "--out", str(tmp_path / "out")]) == 2
    assert (
        "--ray needs the package ray, which is not installed: pip install 'simpick[cluster]'" in capsys.readouterr().err
    )
