"""What commands print can be read and copied."""

import io

from simpick.terminal import Console, narrow_table, track


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
