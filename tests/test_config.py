"""Configurations check types and ranges when they are made, and are loaded from JSON with paths in error texts."""

from __future__ import annotations

import dataclasses
import json
import math
import pickle
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
import tyro
from annotated_types import Interval, MinLen
from hypothesis import given
from hypothesis import strategies as st

from simpick.config import Config, Fraction, PositiveFloat, PositiveInt, from_json, read_json
from simpick.errors import ConfigError
from simpick.training.config import TrainConfig


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Inner(Config):
    size_px: Annotated[int, Interval(ge=16, le=512)] = 96
    span: tuple[PositiveFloat, PositiveFloat] = (0.5, 1.0)

    def _check_rules(self) -> None:
        if self.span[0] > self.span[1]:
            raise ConfigError(f"span must have the smaller value first, got {self.span}")


@dataclass(frozen=True)
class Outer(Config):
    window: PositiveInt
    rate: Annotated[float, Interval(ge=0, lt=1)] = 0.5
    share: Fraction = 1.0
    limit: PositiveInt | None = None
    mode: Literal["coarse", "fine"] = "fine"
    names: Annotated[tuple[str, ...], MinLen(1)] = ("a",)
    inner: Inner = field(default_factory=Inner)
    levels: tuple[Inner, ...] = ()
    folder: Path | None = None
    colour: Colour = Colour.RED
    times: dict[str, float] = field(default_factory=dict)
    on: bool = True
    either: int | str = 0


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"window": 0}, "window must be at least 1, got 0"),
        ({"window": 64.5}, "window must be an integer, got 64.5"),
        ({"window": True}, "window must be an integer, got True"),
        ({"window": 1, "rate": 1.0}, "rate must be at least 0 and below 1, got 1.0"),
        ({"window": 1, "rate": math.nan}, "rate must be a finite number, got nan"),
        ({"window": 1, "rate": True}, "rate must be a finite number, got True"),
        ({"window": 1, "share": "0.5"}, "share must be a finite number, got '0.5'"),
        ({"window": 1, "limit": 0}, "limit must be at least 1, got 0"),
        ({"window": 1, "limit": "a"}, "limit must be an integer or None, got 'a'"),
        ({"window": 1, "mode": "medium"}, "mode must be one of 'coarse', 'fine', got 'medium'"),
        ({"window": 1, "names": ()}, "names must be of length at least 1, got ()"),
        ({"window": 1, "names": ("a", 3)}, "names[1] must be a string, got 3"),
        ({"window": 1, "on": 1}, "on must be True or False, got 1"),
        ({"window": 1, "either": 1.5}, "either must be an integer or a string, got 1.5"),
        ({"window": 1, "inner": None}, "inner must be of type Inner, got None"),
        ({"window": 0, "share": 2.0}, "window must be at least 1, got 0; share must be between 0 and 1, got 2.0"),
    ],
)
def test_construction_reports_every_field_that_is_wrong(values: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        Outer(**values)
    assert str(caught.value) == text


def test_numpy_scalars_count_as_numbers() -> None:
    Outer(window=np.int64(3), rate=np.float32(0.5))  # type: ignore[arg-type]


@given(size_px=st.from_type(Annotated[int, Interval(ge=16, le=512)]))  # type: ignore[arg-type]
def test_every_value_in_range_is_accepted(size_px: int) -> None:
    assert dataclasses.replace(Inner(), size_px=size_px).size_px == size_px


def test_configurations_pickle_and_are_checked_when_replaced() -> None:
    config = Outer(window=3)
    assert pickle.loads(pickle.dumps(config)) == config
    with pytest.raises(ConfigError, match="window must be at least 1"):
        dataclasses.replace(config, window=0)


def test_the_command_line_reads_the_plain_types() -> None:
    arguments = ["--window", "3", "--inner.size-px", "32", "--inner.span", "1", "2", "--limit", "4", "--mode", "coarse"]
    config = tyro.cli(Outer, args=arguments)
    assert config == Outer(3, inner=Inner(32, (1.0, 2.0)), limit=4, mode="coarse")


def test_a_configuration_written_as_json_is_read_back_equal(tmp_path: Path) -> None:
    config = Outer(3, levels=(Inner(32), Inner(64)), folder=Path("a/b"), colour=Colour.BLUE, times={"wall": 2.0})
    file = tmp_path / "config.json"
    file.write_text(json.dumps(config.to_json(), default=str))
    assert from_json(Outer, read_json(file)) == config


def test_integers_in_json_become_floats_where_floats_are_asked_for() -> None:
    share = from_json(Outer, {"window": 3, "share": 1, "times": {"wall": 2}})
    assert isinstance(share.share, float) and isinstance(share.times["wall"], float)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ([1], "Outer must be an object with values by name, got [1]"),
        ({}, "window is missing"),
        (
            {"window": 1, "shore": 2, "zzz": 1},
            "shore is unknown, did you mean 'share'?; zzz is unknown, valid: window,",
        ),
        ({"window": 64.5}, "window must be an integer, got 64.5"),
        ({"window": 1, "share": 10**400}, "share must be a finite number, got an integer of 1329 bits"),
        ({"window": 1, "inner": {"size_px": 8}}, "inner.size_px must be between 16 and 512, got 8"),
        (
            {"window": 1, "inner": {"span": [1, 2, 3]}},
            "inner.span must be a tuple (in JSON a list) of 2 values, got [1",
        ),
        ({"window": 1, "inner": {"span": [2, 1]}}, "inner: span must have the smaller value first, got (2.0, 1.0)"),
        ({"window": 1, "inner": 3}, "inner must be an object with values by name, got 3"),
        ({"window": 1, "levels": [{}, {"size_px": 8}]}, "levels[1].size_px must be between 16 and 512"),
        ({"window": 1, "colour": "green"}, "colour must be one of 'red', 'blue', got 'green'"),
        ({"window": 1, "times": {"wall": "1"}}, "times.wall must be a finite number, got '1'"),
        ({"window": 1, "names": "abc"}, "names must be a tuple (in JSON a list), got 'abc'"),
    ],
)
def test_json_errors_name_the_path_of_the_value(values: Any, text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        from_json(Outer, values, "run.json")
    assert str(caught.value).startswith(f"run.json: {text}")


def test_unknown_names_in_files_name_the_file_and_the_path() -> None:
    with pytest.raises(ConfigError, match=r"^run\.json: data: no randomization preset named 'dark'\. Valid: default"):
        from_json(TrainConfig, {"data": {"randomizations": ["dark"]}}, "run.json")


def test_a_complete_object_must_name_every_field() -> None:
    with pytest.raises(ConfigError, match=r"^span is missing$"):
        from_json(Inner, {"size_px": 32}, complete=True)


def test_a_file_that_is_no_json_object_is_named(tmp_path: Path) -> None:
    (tmp_path / "broken.json").write_text("{")
    (tmp_path / "list.json").write_text("[1]")
    for name, text in (
        ("broken", "be a JSON file, cannot be read"),
        ("missing", "be a JSON file"),
        ("list", "hold a JSON object"),
    ):
        with pytest.raises(ConfigError, match=rf"{name}\.json must {text}"):
            read_json(tmp_path / f"{name}.json")


def test_plain_dataclasses_are_loaded_too() -> None:
    @dataclass(frozen=True)
    class Point:
        x: float
        y: float = 0.0

    globals()["Point"] = Point
    assert from_json(Point, {"x": 1}) == Point(1.0)
