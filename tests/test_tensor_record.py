"""`TensorRecord`: one operation, all tensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from simpick.tensor_record import TensorRecord


@dataclass(frozen=True, eq=False)
class Inner(TensorRecord):
    x: Float[Tensor, "*batch 2"]


@dataclass(frozen=True, eq=False)
class Outer(TensorRecord):
    inner: Inner
    pairs: tuple[tuple[Tensor, Tensor], ...]
    poses: Float[np.ndarray, "*batch 4 4"]
    missing: Inner | None
    stride: int


def outer(value: float, n: int = 3) -> Outer:
    x = value + torch.arange(2.0 * n).view(n, 2)
    return Outer(Inner(x), ((x, -x),), np.full((n, 4, 4), value), None, 7)


def tensors(record: Outer) -> tuple[Tensor, Tensor, Tensor]:
    return record.inner.x, *record.pairs[0]


def test_map_reaches_nested_tensors_and_nothing_else() -> None:
    record = outer(1.0)
    doubled = record.map(lambda x: 2 * x)
    assert all(torch.equal(b, 2 * a) for a, b in zip(tensors(record), tensors(doubled), strict=True))
    assert doubled.poses is record.poses
    assert (doubled.missing, doubled.stride) == (None, 7)


@pytest.mark.parametrize("index", [torch.tensor([2, 0]), np.array([2, 0]), np.array([True, False, True]), slice(1, 3)])
def test_rows_are_those_of_every_tensor_and_array(index) -> None:
    record, chosen = outer(1.0), outer(1.0).rows(index)
    assert all(torch.equal(b, a[index]) for a, b in zip(tensors(record), tensors(chosen), strict=True))
    assert len(chosen.poses) == 2


def test_what_is_stacked_can_be_taken_apart() -> None:
    records = [outer(1.0), outer(2.0)]
    stacked = Outer.stack(records)
    assert stacked.inner.x.shape == (2, 3, 2)
    assert stacked.poses.shape == (2, 3, 4, 4)
    second = stacked.map(lambda x: x[1])
    assert all(torch.equal(a, b) for a, b in zip(tensors(second), tensors(records[1]), strict=True))


def test_rows_of_concatenated_records_follow_one_another() -> None:
    record = Outer.cat([outer(1.0, 1), outer(2.0, 2)])
    assert record.inner.x[:, 0].tolist() == [1.0, 2.0, 4.0]
    assert record.poses[:, 0, 0].tolist() == [1.0, 2.0, 2.0]
    assert record.stride == 7


def test_to_moves_every_tensor() -> None:
    moved = outer(1.0).to(torch.device("meta"))
    assert {x.device.type for x in tensors(moved)} == {"meta"}


def test_rows_are_split_into_equal_groups() -> None:
    record = outer(1.0, n=6).split_rows(2)
    assert record.inner.x.shape == (2, 3, 2) and record.poses.shape == (2, 3, 4, 4)
    assert torch.equal(record.inner.x[1], outer(1.0, n=6).inner.x[3:])
    assert outer(1.0, n=0).split_rows(2).pairs[0][1].shape == (2, 0, 2)


def test_fields_that_are_left_out_of_a_stack_are_empty() -> None:
    records = [outer(1.0), outer(2.0)]
    whole, stacked = Outer.stack(records), Outer.stack(records, without=("pairs",))
    assert [x.shape for x in stacked.pairs[0]] == [(2, 0, 2)] * 2
    assert torch.equal(stacked.inner.x, whole.inner.x) and np.array_equal(stacked.poses, whole.poses)
