"""`TensorRecord`: the base of dataclasses of tensors, with operations that apply to all of their tensors at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Int
from torch import Tensor

# `typing.Self` cannot be checked at run time.
Record = TypeVar("Record", bound="TensorRecord")
Rows = Int[Tensor, "..."] | Bool[Tensor, "..."] | Int[np.ndarray, "..."] | Bool[np.ndarray, "..."] | slice | int


class TensorRecord:
    """Base of frozen dataclasses whose fields are tensors, arrays, or records and tuples of these.

    Other values, None among them, are kept as they are; where several records become one, they are the first record's.
    """

    def map(self: Record, function: Callable[[Tensor], Tensor]) -> Record:
        """Return a record with the function applied to each tensor; arrays are kept as they are."""
        return _mapped(self, Tensor, function)

    def to(self: Record, device: torch.device) -> Record:
        """Return a record with its tensors on a device."""
        return self.map(lambda x: x.to(device, non_blocking=True))

    def rows(self: Record, index: Rows) -> Record:
        """Return a record of these rows of each tensor and array; a single number drops the first dimension."""
        return _mapped(self, (Tensor, np.ndarray), lambda x: x[index])

    def split_rows(self: Record, groups: int) -> Record:
        """Return a record whose first dimension is split into two: equal groups of rows, and the rows of each."""
        return _mapped(self, (Tensor, np.ndarray), lambda x: x.reshape(groups, len(x) // groups, *x.shape[1:]))

    @classmethod
    def stack(cls: type[Record], records: Sequence[Record], *, without: Collection[str] = ()) -> Record:
        """Return one record with a new first dimension.

        Tensors of the fields `without` get a second dimension of length 0 instead of their own first.
        """
        if not without:
            return _joined(records, torch.stack, np.stack)

        def field(name: str) -> Any:
            if name in without:
                return _mapped(getattr(records[0], name), Tensor, lambda x: x.new_empty(len(records), 0, *x.shape[1:]))
            return _joined([getattr(record, name) for record in records], torch.stack, np.stack)

        return _replaced(records[0], field)

    @classmethod
    def cat(cls: type[Record], records: Sequence[Record]) -> Record:
        """Return one record with the rows of one after the other."""
        return _joined(records, torch.cat, np.concatenate)


def _mapped(value: Any, kinds: type | tuple[type, ...], function: Callable[[Any], Any]) -> Any:
    if isinstance(value, kinds):
        return function(value)
    if isinstance(value, TensorRecord):
        return _replaced(value, lambda name: _mapped(getattr(value, name), kinds, function))
    return tuple(_mapped(item, kinds, function) for item in value) if isinstance(value, tuple) else value


def _joined(values: Sequence[Any], join_tensors: Callable[..., Tensor], join_arrays: Callable[..., np.ndarray]) -> Any:
    first = values[0]
    if isinstance(first, Tensor):
        return join_tensors(list(values))
    if isinstance(first, np.ndarray):
        return join_arrays(list(values))
    if isinstance(first, TensorRecord):
        return _replaced(first, lambda name: _joined([getattr(v, name) for v in values], join_tensors, join_arrays))
    if isinstance(first, tuple):
        return tuple(_joined(items, join_tensors, join_arrays) for items in zip(*values, strict=True))
    return first


def _replaced(record: Any, value_of: Callable[[str], Any]) -> Any:
    return dataclasses.replace(record, **{field.name: value_of(field.name) for field in dataclasses.fields(record)})
