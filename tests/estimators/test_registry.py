"""Estimators by name."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from types import SimpleNamespace
from typing import cast

import pytest

from simpick.errors import ConfigError, PluginError, UnknownNameError
from simpick.estimators import PoseEstimator, plugins, registry
from simpick.estimators.raypose import RayPoseEstimator, RayPoseEstimatorConfig
from simpick.estimators.registry import EstimatorName, PoseBudget, estimator_names, find_estimator, load_estimator
from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator


class Telepathy:
    """Another package's estimator."""

    def onboard(self, part):
        pass

    def estimate(self, frame, detections):
        return []


class Clairvoyance(Telepathy):
    """One that makes hypotheses."""

    def __init__(self, hypotheses: int = 1) -> None:
        self.hypotheses = hypotheses


def half() -> SimpleNamespace:
    return SimpleNamespace(onboard=print)


def none() -> None:
    pass


def config_of(estimator: PoseEstimator) -> RayPoseEstimatorConfig | RetrievalConfig:
    assert isinstance(estimator, RayPoseEstimator | RetrievalEstimator)
    return estimator.config


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    places = {
        "telepathy": f"{__name__}:Telepathy",
        "clairvoyance": f"{__name__}:Clairvoyance",
        "half": f"{__name__}:half",
        "none": f"{__name__}:none",
        "gone": "no_such_package:Estimator",
    }
    entries = [EntryPoint(name, place, registry.ENTRY_POINT_GROUP) for name, place in places.items()]
    monkeypatch.setattr(plugins, "entry_points", lambda group: [e for e in entries if e.group == group])


@pytest.mark.parametrize("text", ["retrieval", "retrieval@8", "my-own.one@64"])
def test_a_name_is_written_as_it_is_read(text: str) -> None:
    assert str(EstimatorName.parse(text)) == text


@pytest.mark.parametrize("text", ["", "fine@", "fine@0", "@8", "fine+closer", "fine @8"])
def test_a_malformed_name_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"such as retrieval@8; got {text!r}")):
        EstimatorName.parse(text)


def test_an_unknown_name_lists_what_exists() -> None:
    assert {"oracle", "retrieval"} <= set(estimator_names())
    expected = r"no estimator named 'telepathy'\. Valid: coarse, fine, oracle, refined, retrieval"
    with pytest.raises(UnknownNameError, match=expected):
        load_estimator("telepathy")


def test_hypotheses_are_asked_for_by_name_or_by_number() -> None:
    assert config_of(load_estimator("retrieval@8")).hypotheses == 8
    assert config_of(load_estimator("retrieval", hypotheses=3)).hypotheses == 3
    assert config_of(load_estimator("coarse@4", hypotheses=3)).hypotheses == 4


def test_a_budget_reaches_the_estimator_or_is_refused() -> None:
    config = config_of(load_estimator("coarse", budget=PoseBudget(iterations=0, decoder_steps=7)))
    assert isinstance(config, RayPoseEstimatorConfig)
    assert (config.iterations, config.decoder_steps) == (0, 7)
    with pytest.raises(
        ConfigError, match="iterations and decoder are options of coarse and fine; 'retrieval' has none"
    ):
        load_estimator("retrieval", budget=PoseBudget(decoder_steps=2))


def test_another_packages_estimator_is_found_by_its_entry_point(registered: None) -> None:
    assert "telepathy" in estimator_names()
    assert isinstance(load_estimator("telepathy"), Telepathy)
    assert find_estimator("telepathy").data() == {}
    with pytest.raises(ConfigError, match=r"'telepathy', .*Telepathy, takes no hypotheses; leave it out, or give"):
        load_estimator("telepathy@4")


def test_another_packages_estimator_is_asked_for_hypotheses(registered: None) -> None:
    estimator = load_estimator("clairvoyance@4")
    assert isinstance(estimator, Clairvoyance) and estimator.hypotheses == 4
    assert getattr(load_estimator("clairvoyance"), "hypotheses", None) == 1


def test_what_is_no_estimator_is_refused_by_name(registered: None) -> None:
    for name, text in (
        ("half", r"'half', .*lacks estimate of PoseEstimator, got SimpleNamespace"),
        ("none", r"'none', .*lacks onboard, estimate of PoseEstimator, got NoneType"),
        ("gone", r"'gone', .* cannot be made: ModuleNotFoundError: No module named 'no_such_package'"),
    ):
        with pytest.raises(PluginError, match=text):
            load_estimator(name)


def test_data_name_the_package_that_registered_an_estimator() -> None:
    entry = SimpleNamespace(dist=SimpleNamespace(name="psi", version="1.2"))
    spec = registry.EstimatorSpec(lambda hypotheses, budget: Telepathy(), entry=cast(EntryPoint, entry))
    assert spec.data() == {"package psi": "1.2"}


def test_names_load_no_heavy_library() -> None:
    heavy = "{'torch', 'mujoco', 'trimesh', 'cv2'}"
    code = f"import sys, simpick.estimators.registry; print(sorted({heavy} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
