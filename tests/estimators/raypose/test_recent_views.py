"""Encoded views in a bounded share of memory: which are made, and which are dropped."""

from dataclasses import dataclass

import torch
from torch import Tensor

from simpick.estimators.raypose.recent_views import RecentViews
from simpick.tensor_record import TensorRecord


@dataclass(frozen=True, eq=False)
class Numbered(TensorRecord):
    number: Tensor


def made(log: list[int]):
    """Return a maker of views of 8 bytes each that notes which it made."""

    def make(keys: list[int]) -> list[Numbered]:
        log.extend(keys)
        return [Numbered(torch.tensor(key)) for key in keys]

    return make


def test_each_view_is_made_once_and_returned_in_order() -> None:
    views, log = RecentViews(), []
    found = views.get([3, 1, 3], made(log))
    assert [int(view.number) for view in found] == [3, 1, 3]
    assert log == [3, 1]
    views.get([1, 2], made(log))
    assert log == [3, 1, 2]


def test_the_views_used_longest_ago_are_dropped_where_the_bytes_are_exceeded() -> None:
    views, log = RecentViews(max_bytes=24), []
    views.get([1, 2, 3], made(log))
    views.get([1], made(log))
    views.get([4], made(log))
    assert (len(views), views.bytes) == (3, 24)
    views.get([1, 3, 4], made(log))
    assert log == [1, 2, 3, 4], "2 was dropped, not 1, which was used since"


def test_one_question_is_answered_whole_though_it_exceeds_the_bytes() -> None:
    views = RecentViews(max_bytes=8)
    assert [int(view.number) for view in views.get([1, 2, 3], made([]))] == [1, 2, 3]
    assert (len(views), views.bytes) == (1, 8)
