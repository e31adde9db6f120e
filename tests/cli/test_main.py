"""The command line as a whole: help, names, versions, errors."""

import re
import subprocess
import sys
from itertools import pairwise

import pytest

from simpick import __version__
from simpick.cli.main import COMMANDS, main
from simpick.estimators.registry import SHIPPED
from tests.project.source_imports import source_files

WIDTH = 80


@pytest.fixture(autouse=True)
def narrow(monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", str(WIDTH))


def help_of(command: str, capsys) -> str:
    with pytest.raises(SystemExit) as ended:
        main([*command.split(), "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_help_fits_the_terminal_and_shows_every_default(command: str, capsys) -> None:
    lines = help_of(command, capsys).splitlines()
    assert [line for line in lines if len(line) > WIDTH] == []
    text = " ".join(" ".join(lines).replace("│", " ").replace("|", " ").split())
    assert "(default: None)" not in text and "(default: )" not in text and "{None}" not in text
    assert "--config." not in text, "options stand without the name of the object that holds them"


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_help_breaks_lines_only_where_they_are_full(command: str, capsys) -> None:
    lines = [line.strip("│|").rstrip() for line in help_of(command, capsys).splitlines()]
    early = []
    for line, after in pairwise(lines):
        indent = len(after) - len(after.lstrip())
        is_continued = re.match(r"[A-Za-z(]", after.strip()) and line[indent : indent + 1].strip()
        is_text = not line.lstrip().startswith(("usage", "-", "[{", "╭", "╰"))  # what stands alone above its help, say
        if is_continued and is_text and len(line) + 1 + len(after.split()[0]) < WIDTH - 3:
            early.append((line, after))
    assert early == []


@pytest.mark.parametrize("command", ["run", "pose-benchmark", "evaluate"])
def test_help_names_the_estimators_that_ship(command: str, capsys) -> None:
    words = set(re.findall(r"\w+", help_of(command, capsys)))
    assert words >= SHIPPED.keys()


def test_a_switch_that_is_on_by_default_shows_both_flags(capsys) -> None:
    assert "--network.flow, --network.no-flow" in help_of("train", capsys)


@pytest.mark.parametrize("former", ["--noise", "--scenes", "--perception", "--replace", "--estimators"])
def test_an_option_has_one_name_in_all_commands(former: str, capsys) -> None:
    assert [command for command in COMMANDS if f"{former} " in help_of(command, capsys)] == []


@pytest.mark.parametrize("former", ["--scenes", "--perception", "--replace", "simpick yardstick"])
def test_no_text_names_what_is_called_otherwise_now(former: str) -> None:
    naming = [module for module, file in source_files().items() if former in file.read_text()]
    assert [module for module in naming if module != "simpick.cli.main"] == []


def test_the_overview_is_one_line_per_command(capsys) -> None:
    assert main(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= WIDTH for line in lines)
    listed = {line[2:20].split("  ")[0].strip() for line in lines if line.startswith("  ")}
    assert listed == COMMANDS.keys()


def test_a_group_of_commands_has_its_own_overview(capsys) -> None:
    assert main(["parts", "--help"]) == 0
    shown = capsys.readouterr().out
    assert "usage: simpick parts COMMAND" in shown and "parts remove" in shown and "sweep" not in shown
    assert main(["parts"]) == main([]) == 2
    assert main(["--help", "parts"]) == 0


def test_the_version_is_printed(capsys) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"simpick {__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["swep"], "simpick: no command named 'swep'. Valid: ablate, "),
        (["swep"], "Did you mean 'sweep'?\n"),
        (["parts", "lst"], "Did you mean 'parts list'?\n"),
        (["pose-benchmark", "--bins", "0"], "simpick: bins must be at least 1, got 0\n"),
    ],
)
def test_wrong_input_ends_with_a_message(arguments: list[str], message: str, capsys) -> None:
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


def test_former_names_still_work_and_say_so(capsys) -> None:
    assert main(["yardstick", "--noise=perfect", "--bins", "99"]) == 2
    assert capsys.readouterr().err == (
        "simpick: yardstick is now called pose-benchmark\n"
        "simpick: --noise is now called --detections\n"
        "simpick: bins of the pose benchmark must be between 1 and 50, got 99\n"
    )


def test_no_command_loads_torch_before_its_first_line() -> None:
    modules = sorted({f"simpick.cli.{target.partition(':')[0]}" for target in COMMANDS.values()})
    loads = f"[m for m in {modules} if import_module(m) and 'torch' in sys.modules]"
    code = f"import sys; from importlib import import_module; print({loads})"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_the_overview_loads_no_heavy_library() -> None:
    heavy = "{'torch', 'mujoco', 'rerun', 'mink', 'trimesh', 'cv2', 'matplotlib', 'scipy'}"
    code = (
        f"import sys; from simpick.cli.main import main; main(['--help']); print(sorted({heavy} & sys.modules.keys()))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.endswith("\n[]\n")


@pytest.mark.parametrize("command", ["refiner basin", "parts show", "templates show hex_bolt"])
def test_a_command_replaces_an_image_only_with_overwrite(command: str, tmp_path, capsys) -> None:
    (tmp_path / "old.png").touch()
    assert main([*command.split(), "--out", str(tmp_path / "old.png")]) == 2
    assert "old.png exists already. Choose another file with --out, or pass --overwrite." in capsys.readouterr().err
    assert main([*command.split(), "--out", str(tmp_path / "new.jpg")]) == 2
    assert "out must be a .png file, got " in capsys.readouterr().err


def test_every_command_configures_threads_first(monkeypatch) -> None:
    called = []
    monkeypatch.setattr("simpick.cli.main.configure_threads", lambda: called.append(True))
    assert main(["--version"]) == 0 and called == [True]
