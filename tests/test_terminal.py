"""What commands print can be read and copied."""

import io
import time

import pytest

from simpick import terminal
from simpick.activity import counted, current_activity, doing
from simpick.terminal import Console, breaking_silence, narrow_table, progress_bar, share_bar, track, working


@pytest.fixture
def hurried(monkeypatch) -> None:
    """Write lines every few milliseconds instead of seconds."""
    monkeypatch.setattr(terminal, "FIRST_LINE_S", 0.02)
    monkeypatch.setattr(terminal, "LINE_EVERY_S", 0.02)


def wait_for(stream: io.StringIO, text: str, times: int = 1) -> None:
    """Wait until the text has been written so many times; fail after 5 s."""
    deadline = time.monotonic() + 5
    while stream.getvalue().count(text) < times:
        assert time.monotonic() < deadline, f"{text!r} was not written {times} times: {stream.getvalue()!r}"
        time.sleep(0.005)


def test_a_printed_line_is_neither_wrapped_nor_interpreted() -> None:
    stream = io.StringIO()
    line = "results: logs/run[1]/[red]/" + 60 * "x"
    Console(file=stream, width=40).print_line(line)
    assert stream.getvalue() == line + "\n"


def test_brackets_in_names_are_shown_in_tables_and_progress() -> None:
    stream = io.StringIO()
    console = Console(file=stream, width=60)
    console.print(narrow_table("part", "[/b]", title="logs/[/b]/run", rows=[("[bold]nut[/]", "[/red]")]))
    for _ in track([1], "reading [/b]", console=console):
        pass
    for text in ("logs/[/b]/run", "[bold]nut[/]", "[/red]"):
        assert text in stream.getvalue()


def test_the_first_word_comes_within_two_seconds_and_the_next_within_five() -> None:
    assert terminal.FIRST_LINE_S < 2 and terminal.LINE_EVERY_S < 5


def test_a_file_gets_lines_also_while_nothing_advances(hurried) -> None:
    stream = io.StringIO()
    with progress_bar(Console(file=stream)) as bar:
        task = bar.add_task("bin 3, [/b] refined", total=4)
        wait_for(stream, "bin 3, [/b] refined 0/4 0:00:00\n", times=2)
        bar.advance(task, 3)
        wait_for(stream, "bin 3, [/b] refined 3/4")
    assert "\x1b" not in stream.getvalue(), "no control codes"
    written = stream.getvalue()
    time.sleep(0.06)
    assert stream.getvalue() == written, "nothing comes after the end"


def test_a_kept_display_ends_with_its_last_state(hurried) -> None:
    stream = io.StringIO()
    with progress_bar(Console(file=stream), keep=True) as bar:
        bar.advance(bar.add_task("episodes", total=2), 2)
    assert stream.getvalue().splitlines()[-1].startswith("episodes 2/2")


def test_short_work_writes_nothing_into_a_file() -> None:
    stream = io.StringIO()
    assert list(track([1, 2], "counting", console=Console(file=stream))) == [1, 2]
    assert stream.getvalue() == ""


def test_work_without_a_count_is_named(hurried) -> None:
    stream = io.StringIO()
    with working("writing the report", Console(file=stream)):
        wait_for(stream, "writing the report 0:00:00\n")


def test_a_share_of_work_is_written_with_its_texts(hurried) -> None:
    stream = io.StringIO()
    with share_bar("step {task.fields[n]}", "{task.fields[loss]}", "", console=Console(file=stream)) as bar:
        bar.add_task("train", total=4, completed=1, n=7, loss="loss 0.5")
        wait_for(stream, "step 7  25% loss 0.5 0:00:00\n")


def test_lines_end_where_the_work_fails(hurried) -> None:
    stream = io.StringIO()
    with pytest.raises(RuntimeError), working("failing", Console(file=stream)):
        raise RuntimeError
    written = stream.getvalue()
    time.sleep(0.06)
    assert stream.getvalue() == written


def test_a_full_disk_stops_the_lines_and_not_the_work(hurried) -> None:
    class Full(io.StringIO):
        tried = 0

        def write(self, text: str) -> int:
            self.tried += 1
            raise OSError(28, "No space left on device")

    stream = Full()
    with working("working", Console(file=stream)):
        deadline = time.monotonic() + 5
        while stream.tried < 2:
            assert time.monotonic() < deadline
            time.sleep(0.005)


def test_a_terminal_gets_a_bar() -> None:
    stream = io.StringIO()
    with progress_bar(Console(file=stream, force_terminal=True, width=80), keep=True) as bar:
        bar.advance(bar.add_task("episodes", total=2))
    assert "\x1b[" in stream.getvalue() and "1/2" in stream.getvalue()


def test_a_command_that_shows_nothing_reports_that_it_works(hurried, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr("sys.stdout", stream)
    with breaking_silence("pose-benchmark"):
        wait_for(stream, "simpick pose-benchmark: at work, 0:00:00\n", times=2)
    written = stream.getvalue()
    time.sleep(0.06)
    assert stream.getvalue() == written


def test_progress_and_text_are_no_silence(hurried, monkeypatch: pytest.MonkeyPatch) -> None:
    stream, shown = io.StringIO(), io.StringIO()
    monkeypatch.setattr("sys.stdout", stream)
    with working("filling the bin", Console(file=shown)), breaking_silence("run"):
        wait_for(shown, "filling the bin", times=3)
    assert stream.getvalue() == ""
    before = time.monotonic()
    Console(file=shown).print_line("a line")
    assert terminal._last_text_s >= before


def test_lines_and_bars_say_what_is_being_done(hurried) -> None:
    stream, drawn = io.StringIO(), io.StringIO()
    with progress_bar(Console(file=stream)) as bar:
        bar.add_task("detecting", total=2)
        for _ in counted("ab", "preparing part"):
            wait_for(stream, f"detecting 0/2 0:00:00 ({current_activity()})\n")
    assert "(preparing part 1/2)" in stream.getvalue() and "(preparing part 2/2)" in stream.getvalue()
    with doing("preparing part 3/9"), progress_bar(Console(file=drawn, force_terminal=True, width=120)) as bar:
        bar.add_task("detecting", total=2)
        bar.refresh()
    assert "preparing part 3/9" in drawn.getvalue()


def test_a_command_without_progress_says_what_it_does(hurried, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr("sys.stdout", stream)
    with breaking_silence("estimate"), doing("preparing part 1/4"):
        wait_for(stream, "simpick estimate: preparing part 1/4, 0:00:00\n")


def test_activities_nest_and_end_with_errors() -> None:
    with pytest.raises(RuntimeError), doing("outer"), doing("inner"):
        assert current_activity() == "outer, inner"
        raise RuntimeError
    assert current_activity() == ""
    numbers = counted([5, 6], "part")
    assert next(numbers) == 5 and current_activity() == "part 1/2"
    numbers.close()
    assert current_activity() == "", "also where a loop is left early"


def test_what_has_a_length_is_counted_against_it(hurried) -> None:
    stream = io.StringIO()
    for k, _ in enumerate(track(("a", "b"), "reading", console=Console(file=stream))):
        wait_for(stream, f"reading {k}/2")
