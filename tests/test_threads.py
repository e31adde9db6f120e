"""How many threads libraries start, how they wait, and what the user has set."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from simpick import threads
from simpick.threads import VARIABLES, WAIT_VARIABLE, configure_threads, limited_threads, usable_cores


@pytest.fixture(autouse=True)
def _unset(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no variable be set, neither by the user nor before."""
    monkeypatch.setattr(threads, "_own", {})
    for name in (*VARIABLES, WAIT_VARIABLE):
        # Set first, so that what a test sets is undone.
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)


def test_waiting_threads_sleep_and_there_is_one_per_core_unless_the_user_says_otherwise(monkeypatch) -> None:
    configure_threads()
    assert os.environ[WAIT_VARIABLE] == "PASSIVE" and os.environ["OMP_NUM_THREADS"] == str(usable_cores())
    monkeypatch.setattr(threads, "_own", {})
    monkeypatch.setenv(WAIT_VARIABLE, "ACTIVE")
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    configure_threads()
    assert os.environ[WAIT_VARIABLE] == "ACTIVE" and os.environ["OMP_NUM_THREADS"] == "7"


def test_workers_have_their_own_limit_but_keep_what_the_user_has_set(monkeypatch) -> None:
    monkeypatch.setenv("MKL_NUM_THREADS", "5")
    configure_threads()
    before = dict(os.environ)
    with limited_threads(1):
        assert {name: os.environ[name] for name in VARIABLES} == {
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "MKL_NUM_THREADS": "5",
            "LP_NUM_THREADS": "1",
        }
    assert dict(os.environ) == before


def test_a_containers_quota_and_shared_cores_limit_the_threads(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(threads, "_QUOTA", tmp_path / "cpu.max")
    monkeypatch.setattr(threads, "_CORE_LISTS", tmp_path)
    assert usable_cores() == 8
    for cpu in range(8):
        (tmp_path / f"cpu{cpu}" / "topology").mkdir(parents=True)
        (tmp_path / f"cpu{cpu}" / "topology" / "thread_siblings_list").write_text(f"{cpu % 4},{cpu % 4 + 4}\n")
    assert usable_cores() == 4
    (tmp_path / "cpu.max").write_text("250000 100000\n")
    assert usable_cores() == 2
    (tmp_path / "cpu.max").write_text("50000 100000\n")
    assert usable_cores() == 1
    (tmp_path / "cpu.max").write_text("max 100000\n")
    assert usable_cores() == 4


def test_importing_simpick_and_configuring_threads_loads_no_torch_so_that_it_is_in_time() -> None:
    code = (
        "import sys; from simpick.threads import configure_threads; configure_threads(); print('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"
