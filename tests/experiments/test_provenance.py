"""Results are pinned to what they depend on, and a folder of other weights is refused in words that help."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from simpick.errors import OutputError
from simpick.estimators import detections
from simpick.estimators.raypose import checkpoints
from simpick.estimators.refiner import confidence
from simpick.estimators.registry import SHIPPED
from simpick.experiments.config import CompareConfig, RunConfig
from simpick.experiments.provenance import run_provenance
from simpick.experiments.provenance_changes import changes
from simpick.experiments.result_store import EpisodeResult, ResultStore
from simpick.grasping.store import shipped_path


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of stand-ins for the files that ship."""
    folder = tmp_path / "shipped"
    folder.mkdir()
    (folder / "raypose.safetensors").write_bytes(b"trained")
    monkeypatch.setattr(checkpoints, "shipped_checkpoint", lambda: folder / "raypose.safetensors")
    monkeypatch.setattr(confidence, "SHIPPED_FILE", folder / "confidence.json")
    return folder


def provenance(*modes: str) -> dict:
    config = CompareConfig(modes=modes, parts=("hex_bolt",))
    return run_provenance(config, [RunConfig(parts=config.parts, estimator=mode) for mode in modes])


def test_weights_that_ship_are_among_them() -> None:
    assert SHIPPED["fine"].data().keys() == {"raypose.safetensors"}
    assert SHIPPED["refined"].data().keys() == {"raypose.safetensors", "confidence.json"}
    assert provenance("oracle")["mode_data"] == {"oracle": {}}


def test_other_weights_are_refused_and_results_stay(shipped: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    result = EpisodeResult(0, 0, (), (), "cleared", mode="fine")
    ResultStore(folder, provenance("oracle", "retrieval", "fine")).add(result)
    before = {file.name: file.read_bytes() for file in folder.glob("[!.]*")}
    assert ResultStore(folder, provenance("oracle", "retrieval", "fine")).results == (result,)
    (shipped / "raypose.safetensors").write_bytes(b"trained longer")
    with pytest.raises(
        OutputError,
        # The learned detector, which both modes use, depends on the weights too.
        match=r"weights or data of mode fine, raypose\.safetensors \('\w{16}' there, '\w{16}' now\), weights or data "
        r"of mode retrieval, raypose\.safetensors \('\w{16}' there, '\w{16}' now\)\. They are left as they are\. "
        r"Choose another folder with --out, or --overwrite",
    ) as refusal:
        ResultStore(folder, provenance("oracle", "retrieval", "fine"))
    assert "oracle" not in str(refusal.value)
    assert {file.name: file.read_bytes() for file in folder.glob("[!.]*")} == before


def test_fitted_data_that_appear_are_noticed(shipped: Path) -> None:
    before = provenance("retrieval", "retrieval_refined")
    (shipped / "confidence.json").write_text("{}")
    (change,) = changes(before, provenance("retrieval", "retrieval_refined"))
    assert change.startswith("weights or data of mode retrieval_refined, confidence.json (none there, '")


def test_detections_of_another_package_may_be_boxes_that_the_shipped_detector_fills(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    entry = SimpleNamespace(name="theirs", value="theirs:Detector", dist=SimpleNamespace(name="theirs", version="1.2"))
    monkeypatch.setattr(detections, "entries_of", lambda group: {"theirs": entry})
    config = RunConfig(estimator="fine", detections="theirs")
    data = run_provenance(config, [config])["mode_data"]["fine"]
    assert {"detector.safetensors", "raypose.safetensors"} < data.keys()
    assert (
        "detector.safetensors"
        not in run_provenance(config, [replace(config, detections="perfect")])["mode_data"]["fine"]
    )


def test_another_version_is_named() -> None:
    before = provenance("oracle")
    now = before | {"versions": before["versions"] | {"simpick": "9.0"}}
    assert changes(before, now) == [f"version of simpick ('{before['versions']['simpick']}' there, '9.0' now)"]


def test_a_folder_of_an_older_simpick_is_recognised() -> None:
    old = CompareConfig(modes=("oracle",), parts=("hex_bolt",)).to_json()
    now = provenance("oracle")
    assert changes(json.loads(json.dumps(old)), json.loads(json.dumps(now))) == [
        f"{key} (not stated there, by an older simpick)" for key in ("mode_data", "verified_grasps", "versions")
    ]


def test_more_modes_are_added_in_any_order(shipped: Path) -> None:
    assert changes(provenance("oracle", "fine"), provenance("fine", "coarse", "oracle")) == []
    assert len(changes(provenance("oracle", "fine"), provenance("oracle"))) == 1


def test_other_grasps_are_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = provenance("oracle")
    other = tmp_path / "hex_bolt_jaw.npz"
    other.write_bytes(shipped_path("hex_bolt", "jaw").read_bytes() + b"more")
    monkeypatch.setattr("simpick.experiments.provenance.shipped_path", lambda name, kind: other)
    (change,) = changes(before, provenance("oracle"))
    assert change.startswith("verified_grasps (")
