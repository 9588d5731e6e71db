"""Types of arrays, their shapes and units are in the docstrings; rms, correlation; vectors as complex numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from operator import itemgetter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

TINY = 1e-300
"""Stands for 0 in a denominator or a logarithm."""

_Array = TypeVar('_Array', bound=NDArray[Any])
T = TypeVar('T')


def rms(values: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def correlated_samples(parts: Sequence[Floats]) -> float:
    """Number of neighbours whose errors are alike: 1 + 2 Σ ρ up to the first autocorrelation ρ that is not above 0."""
    size = 2 * max(map(len, parts))
    power = np.sum([np.abs(np.fft.rfft(part, size)) ** 2 for part in parts], axis=0)
    products = np.fft.irfft(power, size)[: size // 2]  # sums of products a lag apart
    if not products[0] > 0:
        return 1.0
    end = int(np.argmax(products <= 0)) or len(products)
    return float(1.0 + 2.0 * (products[1:end] / products[0]).sum())


def effective_count(residual: Floats, mean: float | None = None) -> float:
    """Effective number of independent samples of a residual: n / (1 + 2 Σρ), at least 2.

    Args:
        residual: (n,).
        mean: the expected one, where it is known; else that of the samples.
    """
    centred = residual - (residual.mean() if mean is None else mean)
    return max(len(residual) / correlated_samples([centred]), 2.0)


EVERY = slice(None)
"""All touches: nothing is copied."""


def pick(item: T, which: Any) -> T:
    """Some touches, by a mask, a slice or positions, of an array, or of a tuple of such; anything else stays."""
    return item if which is EVERY else over_arrays(itemgetter(which), item)


def put(item: T, *changes: tuple[Any, T]) -> T:
    """An array, or a tuple of such, with some touches in place of those that were there: which, and they, in turn."""

    def placed(array: Any, *parts: Any) -> Any:
        array = array.copy(order='K')  # touches may be the last axis in memory
        for (which, _), part in zip(changes, parts, strict=True):
            array[which] = part
        return array

    return over_arrays(placed, item, *(part for _, part in changes)) if changes else item


def over_arrays(change: Callable[..., Any], *items: Any) -> Any:
    """A function of arrays applied to tuples of such, part by part; anything else stays."""
    first = items[0]
    if not isinstance(first, tuple):
        return change(*items) if isinstance(first, np.ndarray) else first
    parts = map(partial(over_arrays, change), *items)
    return type(first)(*parts) if hasattr(first, '_fields') else tuple(parts)


def read_only(array: _Array) -> _Array:
    """The same values as an array that cannot be written; the array given stays as it is."""
    view = array.view()
    view.flags.writeable = False
    return view


def pairs(vectors: Complexes) -> Floats:
    """Complex numbers (n,) as vectors (n, 2)."""
    return np.ascontiguousarray(vectors).view(float).reshape(-1, 2)


def unit_vectors(angles: Floats) -> Complexes:
    """exp(i angle), rad, of the shape of the angles."""
    out = np.empty(angles.shape, dtype=complex)
    np.cos(angles, out=out.real)
    np.sin(angles, out=out.imag)
    return out


def as_complex(vectors: Floats) -> Complexes:
    """Vectors (n, 2) as complex numbers (n,)."""
    return np.ascontiguousarray(vectors).view(complex)[:, 0]


def interpolated(at: NDArray[Any], places: NDArray[Any], vectors: Floats) -> Floats:
    """Vectors (n, 2) at increasing places (n,), interpolated at others (k,): (k, 2); beyond the ends those there."""
    return pairs(np.interp(at, places, as_complex(vectors)))


def along_and_across(vectors: Floats, force: Floats) -> Floats:
    """Components of vectors (n, 2) along and across forces (n, 2)."""
    along = force / np.hypot(force[:, 0], force[:, 1])[:, None]
    return pairs(as_complex(vectors) * as_complex(along).conj())
