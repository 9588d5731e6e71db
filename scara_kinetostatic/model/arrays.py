"""Types of the arrays of the package, whose shapes and units are in the docstrings; rms; vectors as complex numbers."""

from __future__ import annotations

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
