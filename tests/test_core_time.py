"""How long threads wait for a core, and how a disturbed measurement is reported."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

from simpick import core_time
from simpick.core_time import CoreTime, disturbance_lines, measured_core_time, total


def test_times_add_up_and_waiting_is_a_share() -> None:
    time_ = total([CoreTime(2.0, 1.0), CoreTime(1.0, 0.0)])
    assert time_ == CoreTime(3.0, 1.0) and time_.waiting == pytest.approx(0.25) and time_.is_disturbed
    assert CoreTime().waiting == 0 and not CoreTime(10.0, 1.0).is_disturbed


def test_only_disturbed_measurements_are_reported() -> None:
    times = {"fine": CoreTime(9.5, 0.5), "refined": CoreTime(6.0, 4.0)}
    (line,) = disturbance_lines(times)
    assert "spent waiting for a core: refined 40%. Times are longer, and picks per hour fewer" in line
    assert disturbance_lines({"fine": times["fine"]}) == []


def test_what_threads_do_in_between_is_counted_also_where_they_begin_or_end(monkeypatch, tmp_path: Path) -> None:
    def write(thread: int, run_s: int, wait_s: int) -> None:
        (tmp_path / str(thread)).mkdir(exist_ok=True)
        (tmp_path / str(thread) / "schedstat").write_text(f"{run_s * 10**9} {wait_s * 10**9} 5\n")

    monkeypatch.setattr(core_time, "_THREADS", tmp_path)
    write(1, 10, 4)
    write(2, 7, 7)
    with measured_core_time() as so_far:
        assert so_far() == CoreTime(0.0, 0.0)
        write(1, 13, 5)
        (tmp_path / "2" / "schedstat").unlink()
        write(3, 2, 1)
        assert (so_far().run_s, so_far().wait_s) == (pytest.approx(5.0), pytest.approx(2.0))


def test_a_system_that_counts_nothing_has_no_waiting(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(core_time, "_THREADS", tmp_path / "missing")
    with measured_core_time() as so_far:
        assert so_far() == CoreTime() and disturbance_lines({"fine": so_far()}) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux counts")
def test_running_is_counted_here() -> None:
    begin = time.process_time()
    with measured_core_time() as so_far:
        while time.process_time() - begin < 0.1:
            pass
    assert so_far().run_s == pytest.approx(0.1, abs=0.05)
