"""Types of arrays, their shapes and units are in the docstrings; rms, correlation; vectors as complex numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

_Array = TypeVar('_Array', bound=NDArray[Any])


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
