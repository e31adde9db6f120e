"""What commands print about the files that they wrote."""

import shlex
from pathlib import Path

import pytest

from simpick.cli.outputs import viewer_command


@pytest.mark.parametrize("name", ["plain.rrd", "my bins (1)/a.rrd", "[/b]/it's $HOME;.rrd"])
def test_the_command_that_opens_a_recording_can_be_pasted(name: str) -> None:
    viewer, recording = shlex.split(viewer_command(Path("logs") / name))
    assert Path(viewer).name == "rerun" and Path(recording) == Path("logs") / name
