"""Estimators by name."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from types import SimpleNamespace
from typing import cast

import pytest

from simpick.errors import ConfigError, UnknownNameError
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


def config_of(estimator: PoseEstimator) -> RayPoseEstimatorConfig | RetrievalConfig:
    assert isinstance(estimator, RayPoseEstimator | RetrievalEstimator)
    return estimator.config


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = EntryPoint("telepathy", f"{__name__}:Telepathy", registry.ENTRY_POINT_GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == entry.group else [])


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
    config = config_of(load_estimator("coarse", budget=PoseBudget(iterations=0, steps=7)))
    assert isinstance(config, RayPoseEstimatorConfig)
    assert (config.iterations, config.steps) == (0, 7)
    with pytest.raises(ConfigError, match="iterations and steps are options of coarse and fine; 'retrieval' has none"):
        load_estimator("retrieval", budget=PoseBudget(steps=2))


def test_another_packages_estimator_is_found_by_its_entry_point(registered: None) -> None:
    assert "telepathy" in estimator_names()
    assert isinstance(load_estimator("telepathy"), Telepathy)
    assert find_estimator("telepathy").data() == {}
    with pytest.raises(ConfigError, match="'telepathy@4' comes from another package"):
        load_estimator("telepathy@4")


def test_data_name_the_package_that_registered_an_estimator() -> None:
    entry = SimpleNamespace(dist=SimpleNamespace(name="psi", version="1.2"))
    spec = registry.EstimatorSpec(lambda hypotheses, budget: Telepathy(), entry=cast(EntryPoint, entry))
    assert spec.data() == {"package psi": "1.2"}


def test_names_load_no_heavy_library() -> None:
    heavy = "{'torch', 'mujoco', 'trimesh', 'cv2'}"
    code = f"import sys, simpick.estimators.registry; print(sorted({heavy} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
