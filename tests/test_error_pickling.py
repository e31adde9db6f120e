"""Errors come whole out of worker processes."""

import pickle

from simpick.errors import ConfigError, SimpickError, UnknownNameError, UnknownPartError, WorkerDiedError


def test_errors_survive_pickling() -> None:
    errors: list[SimpickError] = [
        ConfigError("count must be 1, got 0"),
        UnknownNameError("robot", "kuka", ["ur5e"]),
        UnknownPartError("hexbolt", ["hex_bolt", "tee"]),
        WorkerDiedError({1: -9}),
    ]
    for error in errors:
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error) and str(again) == str(error) and vars(again) == vars(error)
