"""``simpick train`` and ``simpick ablate`` for a few steps on the smallest data."""

import json
from dataclasses import asdict
from pathlib import Path

import cv2
import pytest

from simpick.cli.ablate import Ablate
from simpick.cli.main import main
from simpick.cli.train import Train
from simpick.estimators.raypose.network.config import PRESETS
from tests.training.conftest import TINY_TRAINING

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def options(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("options")
    file = folder / "tiny.json"
    file.write_text(json.dumps(asdict(TINY_TRAINING)))
    resources = ["--device", "cpu", "--renderers", "0", "--shards", str(folder / "shards")]
    return ["--config", str(file), "--size", "tiny", "--steps", "2", *resources]


def test_training_leaves_weights_and_curves_and_resumes(options: list[str], tmp_path: Path, capsys) -> None:
    out = ["--out", str(tmp_path / "run")]
    assert main(["train", "coarse", *options, *out, "--network.no-multiview", "--training.batch", "2"]) == 0
    assert {"weights.safetensors", "curves.png", "scaling.png", "curves.rrd"} <= {
        file.name for file in (tmp_path / "run").iterdir()
    }
    curves = cv2.imread(str(tmp_path / "run" / "curves.png"))
    assert curves is not None and curves.std() > 5
    kept = json.loads((tmp_path / "run" / "config.json").read_text())
    assert kept["network"]["spread_deg"] == 180 and kept["network"]["multiview"] is False
    assert kept["training"]["batch"] == 2 and kept["training"]["data"]["crop_px"] == TINY_TRAINING.data.crop_px
    capsys.readouterr()
    assert main(["train", "fine", *options, *out]) == 2
    assert "holds results of another configuration" in capsys.readouterr().err


def test_training_refuses_what_contradicts_itself(options: list[str], tmp_path: Path, capsys) -> None:
    out = ["--out", str(tmp_path / "run")]
    assert main(["train", "coarse", *options, *out, "--network.spread-deg", "20"]) == 2
    assert "network.spread_deg must be below 180 for fine and 180 for coarse" in capsys.readouterr().err
    assert main(["train", "fine", "--size", "tiny", *out]) == 2
    assert "give minutes or steps" in capsys.readouterr().err
    (tmp_path / "bad.json").write_text('{"data": {"quries": 3}}')
    assert main(["train", "fine", "--steps", "1", *out, "--config", str(tmp_path / "bad.json")]) == 2
    assert "bad.json: data.quries is unknown, did you mean 'queries'?" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_options_set_the_defaults_of_others(tmp_path: Path) -> None:
    file = tmp_path / "settings.json"
    file.write_text('{"batch": 16, "parts": 2, "data": {"seed": 3}}')
    options = Train.defaults(["coarse", "--size=tiny", "--config", str(file), "--seed", "5"])
    assert (options.network.width, options.network.spread_deg) == (PRESETS["tiny"].width, 180.0)
    assert (options.training.batch, options.training.seed, options.training.data.seed) == (16, 5, 5)
    assert Train.defaults(["fine", "--config", str(file)]).training.data.seed == 3
    assert Train.defaults([]).network == PRESETS["small"] and Ablate.defaults([]).network == PRESETS["tiny"]


def test_the_value_of_an_option_is_not_taken_for_the_mode() -> None:
    for before in (
        ["--minutes", "1"],
        ["--size=tiny"],
        ["--network.no-flow"],
        ["--network.flow"],
        ["--training.augmentation.turn"],
    ):
        assert Train.defaults([*before, "coarse"]).network.spread_deg == 180
    assert Train.defaults(["fine", "--out", "coarse"]).network.spread_deg == PRESETS["small"].spread_deg


def test_ablations_fill_both_tables_and_resume(options: list[str], tmp_path: Path) -> None:
    assert main(["ablate", "paper", *options, "--out", str(tmp_path)]) == 0
    text = (tmp_path / "paper.md").read_text()
    results = json.loads((tmp_path / "paper.json").read_text())
    # Both tables begin with what no training gives, which has no templates of its own.
    assert len(results) == 11 and (text.count("| own |"), text.count("| common |")) == (12, 14)
    assert [result["queries"] for result in results] == [0] + 10 * [2 * TINY_TRAINING.batch]
    assert text.count("| no training: the templates' mean | 0 | common |") == 2
    state = (tmp_path / "absolute" / "state.pt").stat().st_mtime_ns
    assert main(["ablate", "paper", *options, "--out", str(tmp_path)]) == 0
    assert (tmp_path / "absolute" / "state.pt").stat().st_mtime_ns == state, "what is finished is not trained again"
    assert json.loads((tmp_path / "paper.json").read_text()) == results


def test_schedules_are_compared_at_every_number_of_steps(options: list[str], tmp_path: Path) -> None:
    assert main(["ablate", "schedules", *options, "--out", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "schedules.json").read_text())
    assert [(row["label"], row["steps"]) for row in rows] == [
        (name, steps) for name in ("log_snr", "cosine", "linear") for steps in (1, 3, 5, 10)
    ]
    assert all(row["ms_per_query"] > 0 for row in rows)
