"""Code that hangs is interrupted, and nothing of the limit is left behind."""

import signal
import threading
import time

import pytest

from simpick.errors import ConfigError
from simpick.estimators.time_limit import DEFAULT_S, TimeLimitError, answer_limit_s, time_limit


def spin() -> None:
    while True:
        pass


def wait() -> None:
    time.sleep(60)


def wait_for_a_lock() -> None:
    threading.Event().wait(60)


def swallow() -> None:
    while True:
        try:
            time.sleep(60)
        except Exception:
            continue


@pytest.mark.parametrize("hang", [spin, wait, wait_for_a_lock, swallow])
def test_python_code_that_hangs_is_interrupted(hang) -> None:
    start = time.monotonic()
    with pytest.raises(TimeLimitError), time_limit(0.05):
        hang()
    assert time.monotonic() - start < 5
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_an_outer_alarm_is_kept() -> None:
    rung: list[int] = []
    before = signal.signal(signal.SIGALRM, lambda signum, frame: rung.append(signum))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with time_limit(60):  # The outer alarm comes first: it stays as it is.
            time.sleep(0.25)
        assert rung
        signal.setitimer(signal.ITIMER_REAL, 30)
        with pytest.raises(TimeLimitError), time_limit(0.02):
            spin()
        assert 25 < signal.getitimer(signal.ITIMER_REAL)[0] < 30
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def test_beside_the_main_thread_a_late_answer_is_an_error_once_it_comes() -> None:
    found: list[str] = []

    def late() -> None:
        try:
            with time_limit(0.01):
                time.sleep(0.05)
        except TimeLimitError:
            found.append("late")

    thread = threading.Thread(target=late)
    thread.start()
    thread.join()
    assert found == ["late"]


def test_the_limit_is_read_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMPICK_TIME_LIMIT_S", raising=False)
    assert answer_limit_s() == DEFAULT_S
    monkeypatch.setenv("SIMPICK_TIME_LIMIT_S", "2.5")
    assert answer_limit_s() == 2.5
    for text in ("soon", "0", "-1", "inf", "nan"):
        monkeypatch.setenv("SIMPICK_TIME_LIMIT_S", text)
        with pytest.raises(ConfigError, match=f"must be a number of seconds above 0, got {text!r}"):
            answer_limit_s()
