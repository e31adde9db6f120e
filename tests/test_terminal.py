"""What commands print can be read and copied."""

import io

from simpick.terminal import Console


def test_a_printed_line_is_neither_wrapped_nor_interpreted() -> None:
    stream = io.StringIO()
    line = "results: logs/run[1]/[red]/" + 60 * "x"
    Console(file=stream, width=40).print_line(line)
    assert stream.getvalue() == line + "\n"
