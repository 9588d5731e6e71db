"""One thread for the linear algebra of NumPy and SciPy, whatever number their libraries would take by themselves.

The matrices of a calibration have some hundred rows and tens of columns. Threads that share one wait for each other
longer than they calculate: on two idle cores a fit takes five times as long, on busy ones up to a hundred times.

Public calls have it for the call alone (`one_thread`), the processes of command and nodes to their end
(`process_of_one_thread`).
"""

from __future__ import annotations

import os
from contextlib import ContextDecorator
from functools import cache
from threading import Lock
from typing import Any


class _OneThread(ContextDecorator):
    """Context and decorator, one for all: where calls overlap, the last one to end restores the numbers of before.

    The libraries have one number for the whole process, so that for so long the caller's other threads have it, too.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._calls = 0
        self._numbers: list[int] = []

    def __enter__(self) -> None:
        with self._lock:
            if not self._calls:
                self._numbers = [library.num_threads for library in _libraries()]
                _set_threads([1] * len(self._numbers))
            self._calls += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._calls -= 1
            if not self._calls:
                _set_threads(self._numbers)


one_thread = _OneThread()


@cache
def _libraries() -> list[Any]:
    """The libraries of linear algebra in this process; SciPy has one of its own, which is loaded with this import."""
    import scipy.linalg  # noqa: F401

    from scara_kinetostatic.errors import naming_missing_libraries

    with naming_missing_libraries():
        from threadpoolctl import ThreadpoolController

    return list(ThreadpoolController().select(user_api='blas').lib_controllers)


def _set_threads(numbers: list[int]) -> None:
    for library, number in zip(_libraries(), numbers, strict=True):
        # from version 3.8 on, the first thread to set a number can keep others from it, who would not notice
        release = getattr(library, 'clear_controlling_thread', lambda **_: None)
        release(force=True)
        library.set_num_threads(number)
        release(force=True)


def process_of_one_thread() -> None:
    """One thread from now to the end of this process and of those it starts; to be called before NumPy is imported."""
    os.environ.update(dict.fromkeys(('OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS'), '1'))
