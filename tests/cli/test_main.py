"""The command line as a whole."""

import pytest

from simpick.cli.main import main


@pytest.mark.parametrize(
    ("command", "options"),
    [
        (("run",), ("--episodes", "--seed", "--parts", "--count", "--gripper", "--perception", "--record", "--out")),
        (("compare",), ("--episodes", "--noise-deg", "--record", "--ray", "--out")),
        (("sweep",), ("--levels-mm", "--levels-deg", "--workers")),
        (("parts", "show"), ("--out", "--columns")),
        (("parts", "add"), ("--unit", "--density")),
        (("templates", "show"), ("--views", "--out")),
        (("grasps", "show"), ("--grippers",)),
        (("evaluate",), ("--dataset", "--scenes", "--export")),
        (("yardstick",), ("--bins", "--hypotheses")),
        (("benchmark",), ("--count",)),
        (("doctor",), ("--only",)),
    ],
)
def test_every_command_tells_its_options_without_prefixes(command, options, capsys) -> None:
    with pytest.raises(SystemExit) as exit:
        main([*command, "--help"])
    printed = capsys.readouterr().out
    assert exit.value.code == 0
    assert all(option in printed for option in options)
    assert "--config." not in printed and "--action." not in printed
