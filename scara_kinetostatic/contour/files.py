"""The files of a contour: `contour.csv`, `contour.svg`, `contour.dxf`.

The CSV holds every point in the order of time, the drawings hold the passes joined to outlines. A DXF of release 12
with POLYLINE entities is read by every CAD program; it has no entry for the unit, which is the millimetre here, as in
the SVG.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from scara_kinetostatic.contour.joining import Outline
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.model.arrays import Floats

CSV, SVG, DXF = 'contour.csv', 'contour.svg', 'contour.dxf'
COLUMNS = ('time_s', 'x_m', 'y_m', 'nx', 'ny', 'std_normal_m', 'force_N')
LAYER = 'CONTOUR'
_MILLI = 1e3
_FRAME = 0.05
"""Blank border of the SVG, as a part of the larger side."""


def csv_text(contour: Contour) -> str:
    """The points of the surface in the order of time."""
    size = np.hypot(*contour.force.T)
    columns = (contour.time, *contour.surface.T, *contour.normal.T, contour.std_normal, size)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    lines = (f'{t:.6f},{x:.9f},{y:.9f},{nx:.6f},{ny:.6f},{std:.3e},{force:.4f}' for t, x, y, nx, ny, std, force in rows)
    return '\n'.join((','.join(COLUMNS), *lines)) + '\n'


def svg_text(outlines: Iterable[Outline]) -> str:
    """The outlines in millimetres, y upwards; printed in their size."""
    outlines = tuple(outlines)
    points = _MILLI * np.concatenate([outline.points for outline in outlines])
    low, high = points.min(axis=0), points.max(axis=0)
    frame = _FRAME * float((high - low).max()) or 1.0
    width, height = high - low + 2 * frame
    corner = (low[0] - frame, high[1] + frame)
    paths = [f'<path d="{_path(_MILLI * outline.points, corner, outline.closed)}"/>' for outline in outlines]
    return '\n'.join(
        (
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm" '
            f'viewBox="0 0 {width:.4f} {height:.4f}">',
            f'<desc>Contour in millimetres; the upper left corner is at x = {corner[0]:.4f}, y = {corner[1]:.4f} in '
            'the base frame, y upwards.</desc>',
            f'<g fill="none" stroke="#000000" stroke-width="{max(width, height) / 500:.4f}" stroke-linejoin="round">',
            *paths,
            '</g>',
            '</svg>',
            '',
        )
    )


def _path(points: Floats, corner: tuple[float, float], closed: bool) -> str:
    pairs = (f'{x - corner[0]:.4f} {corner[1] - y:.4f}' for x, y in points.tolist())
    return 'M' + ' L'.join(pairs) + (' Z' if closed else '')


def dxf_text(outlines: Iterable[Outline]) -> str:
    """The outlines as polylines of a DXF file, release 12, in millimetres."""
    outlines = tuple(outlines)
    points = _MILLI * np.concatenate([outline.points for outline in outlines])
    pairs = [(999, 'contour in millimetres, base frame of the robot')]
    pairs += [*_section('HEADER', _header(points)), *_section('TABLES', _layers())]
    pairs += _section('ENTITIES', (pair for outline in outlines for pair in _polyline(outline)))
    pairs.append((0, 'EOF'))
    return ''.join(f'{code:3d}\n{value}\n' for code, value in pairs)


_Pair = tuple[int, str]
"""A group of a DXF: its code and its value."""


def _section(name: str, content: Iterable[_Pair]) -> list[_Pair]:
    return [(0, 'SECTION'), (2, name), *content, (0, 'ENDSEC')]


def _header(points: Floats) -> Iterator[_Pair]:
    yield from ((9, '$ACADVER'), (1, 'AC1009'))
    for name, (x, y) in (('$EXTMIN', points.min(axis=0)), ('$EXTMAX', points.max(axis=0))):
        yield from ((9, name), (10, f'{x:.6f}'), (20, f'{y:.6f}'), (30, '0.0'))


def _layers() -> Iterator[_Pair]:
    yield from ((0, 'TABLE'), (2, 'LTYPE'), (70, '1'), (0, 'LTYPE'), (2, 'CONTINUOUS'), (70, '0'))
    yield from ((3, 'Solid line'), (72, '65'), (73, '0'), (40, '0.0'), (0, 'ENDTAB'))
    yield from ((0, 'TABLE'), (2, 'LAYER'), (70, '1'), (0, 'LAYER'), (2, LAYER), (70, '0'), (62, '7'))
    yield from ((6, 'CONTINUOUS'), (0, 'ENDTAB'))


def _polyline(outline: Outline) -> Iterator[_Pair]:
    yield from ((0, 'POLYLINE'), (8, LAYER), (66, '1'), (70, '1' if outline.closed else '0'))
    yield from ((10, '0.0'), (20, '0.0'), (30, '0.0'))
    for x, y in (_MILLI * outline.points).tolist():
        yield from ((0, 'VERTEX'), (8, LAYER), (10, f'{x:.6f}'), (20, f'{y:.6f}'), (30, '0.0'))
    yield from ((0, 'SEQEND'), (8, LAYER))
