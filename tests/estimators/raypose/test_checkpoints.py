"""Checkpoints come back whole, or the error says what is wrong with them."""

import dataclasses
import json
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from simpick.errors import CheckpointError
from simpick.estimators.raypose import checkpoints
from simpick.estimators.raypose.checkpoints import load_checkpoint, save_checkpoint, shipped_checkpoint
from tests.estimators.raypose.networks import TINY, awake, condition, noisy_maps, random_query, random_templates


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "model.safetensors"
    save_checkpoint(path, awake(), {"hours": 1.5, "data": "random parts"})
    return path


def rewritten(path: Path, *, header: dict[str, str | None] | None = None, tensors=None, without: str = "") -> Path:
    """Write the file again with another header or other tensors."""
    with safe_open(path, "pt") as file:
        old = file.metadata()
        kept = {name: file.get_tensor(name) for name in file.keys() if name != without}  # noqa: SIM118
    new = {name: value for name, value in {**old, **(header or {})}.items() if value is not None}
    save_file(kept | (tensors or {}), path, new)
    return path


def error_of(path: Path) -> str:
    with pytest.raises(CheckpointError) as caught:
        load_checkpoint(path)
    return str(caught.value)


@pytest.mark.parametrize("multiview", [True, False])
def test_a_checkpoint_gives_back_the_network(tmp_path: Path, multiview: bool) -> None:
    config = dataclasses.replace(TINY, multiview=multiview, spread_deg=180.0, padding=1.3)
    model, path = awake(config), tmp_path / "new" / "model.safetensors"
    path.parent.mkdir()
    save_checkpoint(path, model, {"samples": 12})
    loaded = load_checkpoint(path)
    assert loaded.model.config == config
    assert loaded.card == {"samples": 12}
    assert not loaded.model.training
    model = model.half().float()
    maps, levels = noisy_maps(2, config), torch.tensor([0.0, -5.0])
    with torch.inference_mode():
        before, after = (
            m.denoise(maps, levels, condition(m, random_query(2, config), random_templates(2, config)))
            for m in (model, loaded.model)
        )
    torch.testing.assert_close(after, before, atol=1e-2, rtol=0)
    state = model.state_dict()
    assert all(torch.equal(tensor, state[name]) for name, tensor in loaded.model.state_dict().items())


def test_weights_are_kept_in_half_precision_and_loaded_in_single(saved: Path) -> None:
    with safe_open(saved, "pt") as file:
        assert {file.get_tensor(name).dtype for name in file.keys()} == {torch.float16}  # noqa: SIM118
        assert json.loads(file.metadata()["config"]) == TINY.to_json()
    assert {p.dtype for p in load_checkpoint(saved).model.parameters()} == {torch.float32}


def test_a_missing_file(tmp_path: Path) -> None:
    path = tmp_path / "none.safetensors"
    assert error_of(path) == f"there is no checkpoint {path}; give the path of a .safetensors file of simpick"


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.99])
def test_a_truncated_file(saved: Path, share: float) -> None:
    data = saved.read_bytes()
    saved.write_bytes(data[: int(share * len(data))])
    assert error_of(saved).startswith(f"{saved} is damaged or no safetensors file (")
    assert error_of(saved).endswith("); get it again")


def test_another_kind_of_file(saved: Path) -> None:
    saved.write_text("weights? no, a letter.")
    assert "is damaged or no safetensors file" in error_of(saved)


def test_foreign_weights(tmp_path: Path) -> None:
    path = tmp_path / "other.safetensors"
    save_file({"a": torch.zeros(3)}, path)
    assert error_of(path) == (
        f"{path} must be a checkpoint of RayPose written by simpick, but its format is 'not given'"
    )
    save_file({"a": torch.zeros(3)}, path, {"format": "pt"})
    assert error_of(path).endswith("but its format is 'pt'")


def test_another_version(saved: Path) -> None:
    rewritten(saved, header={"version": "7"})
    assert error_of(saved) == f"{saved} must be of version 4, got '7'; use the simpick that wrote it"
    rewritten(saved, header={"version": None})
    assert error_of(saved) == f"{saved} must be of version 4, got None; use the simpick that wrote it"


@pytest.mark.parametrize(
    ("config", "reason"),
    [
        (None, "'config'"),
        ("{", "Expecting property name"),
        ("[]", "must be an object with values by name"),
        (json.dumps({**TINY.to_json(), "colour": 1}), "colour is unknown"),
        (json.dumps({k: v for k, v in TINY.to_json().items() if k != "width"}), "width is missing"),
        (json.dumps({**TINY.to_json(), "heads": 0}), "heads must be at least 1, got 0"),
        (json.dumps({**TINY.to_json(), "heads": "two"}), "heads must be an integer, got 'two'"),
        (json.dumps({**TINY.to_json(), "matching": "false"}), "matching must be True or False, got 'false'"),
        (json.dumps({**TINY.to_json(), "padding": float("nan")}), "padding must be a finite number, got nan"),
        (json.dumps({**TINY.to_json(), "image_encoder": "resnet"}), "resnet"),
        (json.dumps({**TINY.to_json(), "template_views": "spiral"}), "spiral"),
    ],
)
def test_a_configuration_that_cannot_be_read(saved: Path, config: str | None, reason: str) -> None:
    error = error_of(rewritten(saved, header={"config": config}))
    assert error.startswith(f"the configuration in {saved} cannot be read (")
    assert reason in error
    assert error.endswith("); get the file again")


def test_a_missing_tensor(saved: Path) -> None:
    rewritten(saved, without="embed_image.bias")
    assert error_of(saved) == f"the weights in {saved} do not fit their configuration: embed_image.bias is missing"


def test_an_unknown_tensor(saved: Path) -> None:
    rewritten(saved, tensors={"extra": torch.zeros(2).half()})
    assert error_of(saved) == f"the weights in {saved} do not fit their configuration: extra is unknown"


def test_a_tensor_of_another_shape(saved: Path) -> None:
    rewritten(saved, tensors={"embed_image.bias": torch.zeros(7).half()})
    assert error_of(saved).endswith("configuration: embed_image.bias must have shape (32,), got (7,)")


def test_a_checkpoint_of_another_size_names_three_tensors(saved: Path) -> None:
    rewritten(saved, header={"config": json.dumps({**TINY.to_json(), "width": 64})})
    error = error_of(saved)
    assert error.count("must have shape") == 3
    assert error.endswith(" more")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_no_numbers(saved: Path, value: float) -> None:
    rewritten(saved, tensors={"embed_image.bias": torch.full((32,), value).half()})
    assert error_of(saved) == f"the weights in {saved} must be finite numbers; get the file again"


@pytest.mark.parametrize("kind", [torch.int32, torch.int64, torch.uint8, torch.bool, torch.complex64])
def test_weights_of_another_type(saved: Path, kind: torch.dtype) -> None:
    with safe_open(saved, "pt") as file:
        name = next(iter(file.keys()))
        tensor = file.get_tensor(name)
    path = rewritten(saved, tensors={name: torch.ones(tensor.shape, dtype=kind)})
    assert f"{name} must hold real numbers, got {kind}" in error_of(path)


@pytest.mark.parametrize("card", ["[" * 10**5, "[]", "{", "1" * 5000])
def test_a_card_that_cannot_be_read(saved: Path, card: str) -> None:
    assert "the configuration in" in error_of(rewritten(saved, header={"card": card}))


def test_an_installation_without_weights_says_how_to_train_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoints, "SHIPPED_WEIGHTS", "absent.safetensors")
    with pytest.raises(
        CheckpointError, match=r"has no weights of RayPose \(absent.safetensors is missing\); train some with: simp"
    ):
        shipped_checkpoint()
