"""ARCHITECTURE.md names every room, in the order in which rooms may import each other, and only what exists."""

import re
from pathlib import Path

from tests.project.test_import_directions import ROOMS

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "ARCHITECTURE.md").read_text()


def test_import_order_is_that_of_the_rooms() -> None:
    (order,) = re.findall(r"((?:^    .*\n)+)", TEXT.partition("| room |")[0], re.MULTILINE)
    assert tuple(re.findall(r"\w+", order)) == ROOMS


def test_every_room_is_described() -> None:
    rows = " ".join(re.findall(r"^\| (`.*?) \|", TEXT, re.MULTILINE))
    for room in ROOMS:
        assert re.search(rf"\b{room}\b", rows), f"{room} is missing in the table"


def test_paths_exist() -> None:
    paths = re.findall(r"`((?:simpick|assets|envs|estimators|tests|docs)/[\w./]*)`", TEXT)
    assert [path for path in paths if not (ROOT / path).exists()] == []
