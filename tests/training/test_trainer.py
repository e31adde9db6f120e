"""Training runs of a few steps at the smallest size: exact resume, and what stops a run."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from simpick.errors import ConfigError, OutputError, SimpickError
from simpick.estimators.raypose.checkpoints import load_checkpoint
from simpick.estimators.raypose.diffusion.schedule import SCHEDULES
from simpick.estimators.raypose.network.config import preset
from simpick.estimators.raypose.network.loss_weights import LossWeights
from simpick.training import trainer
from simpick.training.budget import Budget
from simpick.training.config import TrainConfig, read_train_config
from simpick.training.resources import Resources
from simpick.training.trainer import train
from tests.training.conftest import TINY, TINY_TRAINING

pytestmark = pytest.mark.render

NETWORK = replace(preset("tiny"), templates=3)
STEPS = 6


@pytest.fixture
def resources(tiny_shards: Path) -> Resources:
    return Resources(device="cpu", renderers=0, shards=tiny_shards)


@pytest.fixture(scope="module")
def straight(tiny_shards: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without interruption."""
    folder = tmp_path_factory.mktemp("straight")
    train(NETWORK, TINY_TRAINING, Budget(steps=STEPS), folder, resources=Resources("cpu", 0, shards=tiny_shards))
    return folder


def saved(folder: Path) -> dict:
    return torch.load(folder / "state.pt", weights_only=True)


def test_a_run_that_was_interrupted_resumes_bit_by_bit(straight: Path, resources: Resources, tmp_path: Path) -> None:
    def interrupt(row: dict, progress: float) -> None:
        if row["step"] == 2:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    often = replace(resources, validate_every_s=0.0)
    with pytest.raises(KeyboardInterrupt):
        train(NETWORK, TINY_TRAINING, Budget(steps=STEPS), tmp_path, resources=often, on_row=interrupt)
    assert signal.getsignal(signal.SIGINT) is before
    assert saved(tmp_path)["step"] == 3, "the current step is finished first"
    train(NETWORK, TINY_TRAINING, Budget(steps=STEPS), tmp_path, resources=resources)
    ours, theirs = saved(tmp_path), saved(straight)
    assert ours["step"] == theirs["step"] == STEPS
    for kind in ("model", "average"):
        for name, tensor in theirs[kind].items():
            assert torch.equal(ours[kind][name], tensor), name
    for number, moments in theirs["optimizer"]["state"].items():
        assert torch.equal(ours["optimizer"]["state"][number]["exp_avg_sq"], moments["exp_avg_sq"])
    assert ours["seconds"] > 0


def test_training_moves_the_weights_and_their_average_follows(
    straight: Path, resources: Resources, tmp_path: Path
) -> None:
    train(NETWORK, TINY_TRAINING, Budget(steps=1), tmp_path, resources=resources)
    one, six = saved(tmp_path), saved(straight)
    moved = [name for name in six["model"] if not torch.equal(one["model"][name], six["model"][name])]
    assert len(moved) > 0.9 * len(six["model"])
    assert any(not torch.equal(six["average"][f"module.{name}"], six["model"][name]) for name in six["model"])


def test_the_log_has_the_loss_the_rates_and_sampled_poses(straight: Path) -> None:
    rows = [json.loads(line) for line in (straight / "log.jsonl").read_text().splitlines()]
    last = {row["split"]: row for row in rows}
    assert last["train"]["step"] == STEPS and last["train"]["queries"] == STEPS * TINY_TRAINING.batch
    assert last["train"]["loss"] > 0 and last["train"]["matching"] > 0 and last["train"]["queries_per_s"] > 0
    assert 0 <= last["train"]["waiting_share"] <= 1
    assert 0 <= last["validation"]["rotation_deg"] <= 180
    assert last["validation"]["below_5_deg"] <= last["validation"]["below_30_deg"] <= 1


def test_the_weights_come_with_their_card(straight: Path) -> None:
    checkpoint = load_checkpoint(straight / "weights.safetensors")
    assert checkpoint.model.config == NETWORK
    card, rows = checkpoint.card, (straight / "log.jsonl").read_text().splitlines()
    assert card["steps"] == STEPS and card["queries"] == STEPS * TINY_TRAINING.batch
    assert card["training"]["data"]["crop_px"] == TINY.crop_px
    logged = [row for row in map(json.loads, rows) if row["split"] == "validation"][-1]
    assert card["validation"] == {name: logged[name] for name in card["validation"]} and card["validation"]
    assert card["hours"] == pytest.approx(saved(straight)["seconds"] / 3600)
    average = saved(straight)["average"]
    for name, tensor in checkpoint.model.state_dict().items():
        assert torch.equal(tensor, average[f"module.{name}"].half().float()), name


def test_a_finished_run_does_nothing_more(straight: Path, resources: Resources) -> None:
    before = (straight / "log.jsonl").read_text()
    assert train(NETWORK, TINY_TRAINING, Budget(steps=STEPS), straight, resources=resources).exists()
    assert (straight / "log.jsonl").read_text() == before


def test_a_run_begins_with_given_weights(straight: Path, resources: Resources, tmp_path: Path) -> None:
    slow = replace(TINY_TRAINING, learning_rate=1e-12)
    train(NETWORK, slow, Budget(steps=1), tmp_path, resources=resources, start_from=straight / "weights.safetensors")
    average, begun = saved(straight)["average"], saved(tmp_path)["model"]
    for name, tensor in begun.items():
        assert torch.allclose(tensor, average[f"module.{name}"].half().float(), atol=1e-6), name


def test_weights_of_another_size_are_refused(straight: Path, resources: Resources, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"must hold weights of this network's size"):
        train(
            replace(NETWORK, width=64),
            TINY_TRAINING,
            Budget(steps=1),
            tmp_path,
            resources=resources,
            start_from=straight / "weights.safetensors",
        )


def test_a_folder_of_another_run_is_refused_with_what_differs(straight: Path, resources: Resources) -> None:
    other = replace(TINY_TRAINING, learning_rate=5e-4, data=replace(TINY, tilt_deg=10.0))
    with pytest.raises(
        OutputError,
        match=r"another configuration: network\.spread_deg \(\S+ there, 15\.0 now\), training\.data\.tilt_deg \(.*\), "
        r"training\.learning_rate \(.*, 0\.0005 now\)\. .* Choose another folder with --out$",
    ):
        train(replace(NETWORK, spread_deg=15.0), other, Budget(steps=STEPS), straight, resources=resources)


def test_a_damaged_state_is_reported_and_kept(straight: Path, resources: Resources, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_bytes((straight / "config.json").read_bytes())
    damaged = (straight / "state.pt").read_bytes()[:5000]
    (tmp_path / "state.pt").write_bytes(damaged)
    with pytest.raises(ConfigError, match=r"state\.pt is damaged .* delete it to start again"):
        train(NETWORK, TINY_TRAINING, Budget(steps=STEPS), tmp_path, resources=resources)
    assert (tmp_path / "state.pt").read_bytes() == damaged


def test_a_state_of_another_version_is_reported(straight: Path, resources: Resources, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_bytes((straight / "config.json").read_bytes())
    state = saved(straight)
    state["average"] = state["model"]
    torch.save(state, tmp_path / "state.pt")
    with pytest.raises(ConfigError, match="is of another version of simpick and cannot be resumed; choose another"):
        train(NETWORK, TINY_TRAINING, Budget(steps=STEPS), tmp_path, resources=resources)


def test_a_loss_that_is_not_a_number_ends_the_run_and_saves_nothing(
    resources: Resources, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "weighted_sum", lambda terms, weights: sum(terms.values()) * torch.tensor(torch.nan))
    with pytest.raises(SimpickError, match=r"the loss is no longer a number at step 0; .* lower learning_rate"):
        train(NETWORK, TINY_TRAINING, Budget(steps=STEPS), tmp_path, resources=resources)
    assert not (tmp_path / "state.pt").exists() and not (tmp_path / "weights.safetensors").exists()


def test_a_frozen_encoder_without_weights_is_refused(tmp_path: Path) -> None:
    config, budget = replace(TINY_TRAINING, templates=3), Budget(steps=1)
    with pytest.raises(ConfigError, match=r"'dinov2_vitb14' is frozen: give a local file with its weights"):
        train(replace(preset("paper")), config, budget, tmp_path / "a", resources=Resources("cpu", 0))
    with pytest.raises(ConfigError, match="dino_weights are for DINOv2 as image encoder"):
        train(
            NETWORK, config, budget, tmp_path / "b", resources=Resources("cpu", 0), dino_weights=tmp_path / "dino.pth"
        )


def test_more_templates_than_the_network_takes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"templates must be at most the network's 3, got 4"):
        train(NETWORK, replace(TINY_TRAINING, templates=4), Budget(steps=1), tmp_path)


@pytest.mark.parametrize("budget", [{}, {"steps": 0}, {"minutes": -1.0}])
def test_a_run_needs_an_end(budget: dict) -> None:
    with pytest.raises(ConfigError, match=r"give minutes or steps|must be (above 0|at least 1), got"):
        Budget(**budget)


def test_the_budget_that_is_spent_first_ends_a_run() -> None:
    budget = Budget(minutes=2.0, steps=100)
    assert budget.progress(50, 30.0) == 0.5
    assert budget.progress(50, 120.0) == 1.0


def test_the_learning_rate_rises_stays_and_falls() -> None:
    config = TrainConfig(learning_rate=1.0, warmup_steps=10, decay_fraction=0.5)
    assert config.learning_rate_at(0, 0.0) == pytest.approx(0.1)
    assert config.learning_rate_at(9, 0.2) == config.learning_rate_at(50, 0.5) == 1.0
    assert config.learning_rate_at(99, 1.0) == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"batch": 0}, "batch must be at least 1, got 0"),
        ({"batch": 5, "parts": 2}, "parts must divide batch, got parts=2, batch=5"),
        ({"window": 2}, "window must hold as many shards as parts=4, got 2"),
        ({"learning_rate": float("nan")}, "learning_rate must be a finite number, got nan"),
        ({"ema_decay": 1.0}, "ema_decay must be at least 0 and below 1, got 1.0"),
        ({"warmup_steps": -1}, "warmup_steps must be at least 0, got -1"),
    ],
)
def test_settings_out_of_range_are_refused(change: dict, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        TrainConfig(**change)
    assert message in str(caught.value)


def test_every_noise_schedule_can_be_trained_with() -> None:
    assert [TrainConfig(schedule=name).schedule for name in SCHEDULES] == list(SCHEDULES)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"schedule": "quadratic"}, "schedule must be one of 'log_snr', 'cosine', 'linear', got 'quadratic'"),
        ({"window": 64.5}, "window must be an integer, got 64.5"),
        ({"max_grad_norm": True}, "max_grad_norm must be a finite number, got True"),
        ({"data": {"templates": {"size_px": 8}}}, "data.templates.size_px must be between 16 and 1024, got 8"),
        ({"losses": {"mathcing": 1.0}}, "losses.mathcing is unknown, did you mean 'matching'?"),
    ],
)
def test_a_file_of_settings_is_checked_before_training(values: dict, message: str, tmp_path: Path) -> None:
    file = tmp_path / "settings.json"
    file.write_text(json.dumps(values))
    with pytest.raises(ConfigError) as caught:
        read_train_config(file)
    assert str(caught.value) == f"{file}: {message}"


def test_the_configuration_of_a_run_is_read_back(straight: Path) -> None:
    assert read_train_config(straight / "config.json") == TINY_TRAINING


def test_a_weight_below_zero_is_refused() -> None:
    with pytest.raises(ConfigError, match="matching must be at least 0, got -1"):
        LossWeights(matching=-1.0)
