"""Shards in order from renderer processes; a stream that was stopped resumes with the same ones."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.training.data.shard import Shard
from simpick.training.data.shard_stream import ShardStream
from tests.training.conftest import TINY

pytestmark = pytest.mark.render


def test_shards_of_a_worker_equal_those_made_here_even_if_it_is_killed(tiny_shard: Shard, tmp_path: Path) -> None:
    with ShardStream(tmp_path, TINY, split="train", workers=1, prefetch=2) as stream:
        first = stream.get(0)
        os.kill(stream.worker_pids[0], signal.SIGKILL)
        second = stream.get(1)
        assert stream.workers_replaced == 1
        assert stream.waited_s > 0
        stream.release(0)
        assert not stream.path(0).exists() and stream.path(1).exists()
    assert np.array_equal(first.rgb, tiny_shard.rgb) and np.array_equal(first.Ts_crop_part, tiny_shard.Ts_crop_part)
    assert second.part != first.part


def test_a_stream_goes_on_with_what_it_left_and_mends_what_is_damaged(tmp_path: Path) -> None:
    with ShardStream(tmp_path, TINY, split="train", workers=0) as stream:
        shards = [stream.get(k) for k in (0, 1)]
    stamp = stream.path(1).stat().st_mtime_ns
    with ShardStream(tmp_path, TINY, split="train", workers=0, start=1) as again:
        assert not again.path(0).exists()
        assert np.array_equal(again.get(1).rgb, shards[1].rgb)
        assert again.path(1).stat().st_mtime_ns == stamp
        again.path(1).write_bytes(again.path(1).read_bytes()[:1000])
        assert np.array_equal(again.get(1).rgb, shards[1].rgb)


def test_another_configuration_or_split_finds_nothing_and_deletes_nothing(tiny_shard: Shard, tmp_path: Path) -> None:
    stream = ShardStream(tmp_path, TINY, split="train", workers=0)
    tiny_shard.save(stream.path(0))
    others = [
        ShardStream(tmp_path, replace(TINY, seed=1), split="train", workers=0, start=5),
        ShardStream(tmp_path, TINY, split="validation", workers=0, start=5),
    ]
    assert len({s.path(0) for s in (stream, *others)}) == 3
    assert stream.path(0).exists()


def test_a_stream_that_keeps_deletes_nothing(tiny_shard: Shard, tmp_path: Path) -> None:
    stream = ShardStream(tmp_path, TINY, split="train", workers=0, keep=True)
    tiny_shard.save(stream.path(0))
    stream.release(0)
    ShardStream(tmp_path, TINY, split="train", workers=0, start=3, keep=True)
    assert stream.path(0).exists()


def test_numbers_out_of_range_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"workers, prefetch and start must not be negative, got -1, 4 and 0"):
        ShardStream(tmp_path, TINY, split="train", workers=-1)
    with pytest.raises(ConfigError, match=r"prefetch must be 1 or more with 2 workers, got 0"):
        ShardStream(tmp_path, TINY, split="train", workers=2, prefetch=0)
