"""The texts of the errors that users meet first: what was given, what is valid, what to do."""

import pickle
from collections.abc import Callable
from pathlib import Path

import pytest

from simpick import BinPickEnv, get_part, load_estimator
from simpick.assets import library_part_names, remove_user_part
from simpick.errors import ConfigError, SimpickError, UnknownNameError, UnknownPartError, WorkerDiedError
from simpick.estimators import OracleEstimator, PoseBudget, PoseNoise, SegmentationDetector
from simpick.estimators.raypose import load_checkpoint
from simpick.experiments import CompareConfig, RunConfig
from simpick.scene.config import BinConfig

ESTIMATORS = "coarse, fine, oracle, refined, retrieval, retrieval_refined"
MESSAGES: list[tuple[Callable[[], object], str]] = [
    (
        lambda: get_part("hexbolt"),
        f"no part named 'hexbolt'. Valid: {', '.join(library_part_names())}. A path to a CAD file (STL, OBJ, PLY, "
        "GLB, OFF, STEP, 3MF, DAE) is a part, too. Did you mean 'hex_bolt'?",
    ),
    (lambda: get_part("missing.stl"), "no mesh file at missing.stl. Check the path."),
    (
        lambda: remove_user_part("brick"),
        "no added part named 'brick'. Valid: none so far. To see all parts: simpick parts list.",
    ),
    (
        lambda: load_estimator("telepathy"),
        f"no estimator named 'telepathy'. Valid: {ESTIMATORS}. Other packages add theirs as entry points of "
        "'simpick.estimators'.",
    ),
    (
        lambda: load_estimator("oracle"),
        "the oracle takes the true poses from an environment: make OracleEstimator(env.truth)",
    ),
    (
        lambda: load_estimator("retrieval@0"),
        "an estimator must be written NAME or NAME@K with K hypotheses, 1 or more, such as retrieval@8; got "
        "'retrieval@0'",
    ),
    (
        lambda: load_estimator("retrieval", budget=PoseBudget(decoder_steps=2)),
        "iterations and decoder are options of coarse and fine; 'retrieval' has none. Leave them out",
    ),
    (
        lambda: load_checkpoint(Path("none.safetensors")),
        "there is no checkpoint none.safetensors; give the path of a .safetensors file of simpick",
    ),
    (lambda: RunConfig(episodes=0, seed=-1), "episodes must be at least 1, got 0; seed must be at least 0, got -1"),
    (
        lambda: RunConfig(estimator="fine", noise_mm=2.0),
        "noise_deg and noise_mm are for estimator 'oracle', got estimator 'fine'; add --estimator oracle",
    ),
    (
        lambda: RunConfig(estimator="fine@8+closer"),
        "estimator must be a name alone, got the mode 'fine@8+closer' of a comparison; set hypotheses, noise_deg, "
        "noise_mm and look_closer instead",
    ),
    (lambda: BinConfig(width_m=300.0), "width_m must be between 0.05 and 1, got 300.0 (give metres, not millimetres)"),
    (
        lambda: CompareConfig(modes=("orcale", "retrieval", "retrieval")).runs(),
        "modes:\n  - no mode named 'orcale'. Valid: coarse, fine, oracle, oracle_noise, refined, retrieval, "
        "retrieval_refined. Did you mean 'oracle'?\n  - 'retrieval' is named twice",
    ),
    (
        lambda: BinPickEnv(parts="hex_bolt"),  # type: ignore[arg-type]
        "parts must be a list of names or mesh files, got 'hex_bolt'; write ['hex_bolt']",
    ),
    (lambda: BinPickEnv(count=60), "count must be between 1 and 50, got 60"),
    (
        lambda: BinPickEnv(gripper="claw"),
        "no gripper named 'claw'. Valid: jaw, suction. Other packages add theirs as entry points of "
        "'simpick.grippers'.",
    ),
    (
        lambda: BinPickEnv(randomization="strng"),
        "no randomization preset named 'strng'. Valid: default, none, photo, strong. Did you mean 'strong'?",
    ),
    (
        lambda: OracleEstimator(tuple, PoseNoise(1.0)),
        "an oracle with noise needs a random generator: pass rng=numpy.random.default_rng(seed)",
    ),
    (
        lambda: SegmentationDetector("realistic", instance_parts=()),
        "noisy detections need a random generator: pass rng=numpy.random.default_rng(seed)",
    ),
]


@pytest.mark.parametrize(("provoke", "message"), MESSAGES, ids=[message[:40] for _, message in MESSAGES])
def test_the_message_is_complete(provoke: Callable[[], object], message: str, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path))  # no added parts
    with pytest.raises(SimpickError) as raised:
        provoke()
    assert str(raised.value) == message


def test_errors_survive_pickling() -> None:
    errors: list[SimpickError] = [
        ConfigError("count must be 1, got 0"),
        UnknownNameError("robot", "kuka", ["ur5e"]),
        UnknownPartError("hexbolt", ["hex_bolt", "tee"]),
        WorkerDiedError({1: -9}),
    ]
    for error in errors:
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error)
        assert str(again) == str(error)
        assert vars(again) == vars(error)
