"""Many touches in blocks that stay in the processor's cache, put together touch by touch.

Everything that is done to single touches is done to one block after the other: the intermediate results of a
block, some hundred arrays, never leave the cache, and memory holds the final ones alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np

BLOCK = 4096
"""Touches per block: 32 KiB per array of numbers."""

T = TypeVar('T')


def blocks(count: int) -> Iterator[slice]:
    """The places of the touches of each block."""
    return (slice(start, min(start + BLOCK, count)) for start in range(0, count, BLOCK))


def in_blocks(count: int, run: Callable[[slice], T]) -> T:
    """What `run` gives for all touches, from what it gives for blocks.

    Args:
        count: of touches.
        run: from the places of some touches to arrays over these (first axis), or tuples of such, or None.
    """
    if count <= BLOCK:
        return run(slice(0, count))
    whole: Any = None
    for part in blocks(count):
        done = run(part)
        whole = _like(done, count) if whole is None else whole
        _put(whole, part, done)
    return whole


def pick(item: T, which: Any) -> T:
    """Some touches of an array, or of a tuple of such, or None."""
    return _each(item, lambda array: array[which])


def _like(item: T, count: int) -> T:
    """Room for `count` touches, values of one kind together in memory as they are in `item`."""

    def room(array: Any) -> Any:
        order = np.argsort([-abs(stride) for stride in array.strides], kind='stable')
        shape = np.array((count, *array.shape[1:]))
        return np.empty(tuple(shape[order]), array.dtype).transpose(np.argsort(order))

    return _each(item, room)


def _put(whole: Any, where: slice, item: Any) -> None:
    if isinstance(item, tuple):
        for target, part in zip(whole, item, strict=True):
            _put(target, where, part)
    elif item is not None:
        whole[where] = item


def _each(item: Any, change: Callable[[Any], Any]) -> Any:
    if isinstance(item, tuple):
        parts = [_each(part, change) for part in item]
        return type(item)(*parts) if hasattr(item, '_fields') else tuple(parts)
    return None if item is None else change(item)
