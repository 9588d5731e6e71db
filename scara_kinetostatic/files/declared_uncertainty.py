"""The keys of a cell description that say how well it is known: plates, uncertainties, tolerance.

All uncertainties are standard uncertainties (GUM, JCGM 100, 2.3.1); one that is absent means exactly known.
"""

from __future__ import annotations

from typing import Any

from scara_kinetostatic.files.yaml_section import Section
from scara_kinetostatic.model.cell import Cell, Disc, Plate, Uncertainty
from scara_kinetostatic.model.parameters import NAMES, UNITS

COMMON = ('radius', 'force_gain', 'force_rotation')
"""Keys of the section `uncertainty` beside `nominal`."""
_LARGEST_STD = {'m': 2e-3, 'rad': 0.2, '': 0.2}
"""Largest standard uncertainty that is accepted, by unit: what is known worse than that is not known."""
_LARGEST_OF_PLATE = 0.02
"""The same of the place of a plate, m: it is found by touch."""
_LARGEST_TOLERANCE = 5e-3
"""Largest tolerance of the tip that is accepted, m: any calibration meets it."""
_REMEDIES = {
    'm': 'it is in m: 1.5e-5 for 15 µm',
    'rad': 'it is in rad: 1.0e-3 for 0.06 deg',
    '': 'it is a part of 1: 0.005 for 0.5 %',
}


def disc_entry(disc: Disc) -> dict[str, Any]:
    """A disc as the cell description has it."""
    entry: dict[str, Any] = {'name': disc.name, 'center': [disc.x, disc.y], 'radius': disc.radius}
    stds = {'center': disc.center_std, 'radius': disc.radius_std}
    return entry | _stated(stds) | ({'plate': disc.plate} if disc.plate else {})


def _plate_entry(plate: Plate) -> dict[str, Any]:
    stds = {'center': plate.center_std, 'angle': plate.angle_std}
    return {'name': plate.name, 'origin': [plate.x, plate.y], **_stated(stds)}


def _stated(stds: dict[str, float]) -> dict[str, Any]:
    """The key `uncertainty` with what is not exactly known; nothing if all is."""
    stated = {name: std for name, std in stds.items() if std}
    return {'uncertainty': stated} if stated else {}


def read_plates(top: Section) -> tuple[Plate, ...]:
    """The plates of a cell description."""
    if top.data.get('plates') is None:
        return ()
    plates: list[Plate] = []
    for section in top.items('plates', 'plates', ('name', 'origin'), ('uncertainty',)):
        name = section.word('name')
        if name in (plate.name for plate in plates):
            raise section.error('name', f'another plate is named {name!r}, too', 'give every plate its own name')
        x, y = section.vector('origin', ('x', 'y'), 'm')
        plates.append(Plate(name, x, y, *read_stds(section, {'center': 'm', 'angle': 'rad'}, _LARGEST_OF_PLATE)))
    return tuple(plates)


def read_stds(section: Section, units: dict[str, str], longest: float = _LARGEST_STD['m']) -> list[float]:
    """Standard uncertainties under the key `uncertainty`, 0 where absent; lengths are at most `longest`, m."""
    inner = section.section('uncertainty', (), units)
    return [_std(inner, name, unit, longest) for name, unit in units.items()]


def _std(section: Section, name: str, unit: str = '', longest: float = _LARGEST_STD['m']) -> float:
    """A standard uncertainty of a plausible size, 0 where it is not there."""
    if section.data.get(name) is None:
        return 0.0
    std, most = section.not_negative(name), longest if unit == 'm' else _LARGEST_STD[unit]
    if std > most:
        expected = f'expected at most {most:g} {unit}'.rstrip()
        raise section.error(name, f'{expected}, got {std:g}', _REMEDIES[unit])
    return std


def read_uncertainty(section: Section) -> Uncertainty:
    """The section `uncertainty`: what is common to all touches."""
    nominal = section.section('nominal', (), NAMES)
    for name in nominal.data:
        nominal.positive(name, UNITS[name])
    return Uncertainty(
        _std(section, 'radius', 'm'),
        _std(section, 'force_gain'),
        _std(section, 'force_rotation', 'rad'),
        {name: float(value) for name, value in nominal.data.items()},
    )


def read_optional(section: Section, name: str) -> float | None:
    """A length above 0, None where it is not there."""
    return None if section.data.get(name) is None else section.positive(name, 'm')


def read_tolerance(top: Section) -> float | None:
    """The tolerance of the tip, m; None where none is stated."""
    section = top.section('tolerance', (), ('tip',))
    if section.data.get('tip') is None:
        return None
    tolerance = section.positive('tip')
    if tolerance > _LARGEST_TOLERANCE:
        problem = f'expected a tolerance of at most {_LARGEST_TOLERANCE:g} m, got {tolerance:g}'
        raise section.error('tip', problem, 'give it in m: 5.0e-5 for 50 µm')
    return tolerance


def uncertainty_entries(cell: Cell) -> dict[str, Any]:
    """The keys of a cell description beside its discs that say how well it is known; what is not stated is left out."""
    u = cell.uncertainty
    common: dict[str, Any] = {name: getattr(u, name) for name in COMMON if getattr(u, name)}
    entries = {
        'plates': [_plate_entry(plate) for plate in cell.plates],
        'uncertainty': common | ({'nominal': dict(u.nominal)} if u.nominal else {}),
        'tolerance': {'tip': cell.tolerance} if cell.tolerance else {},
        'tip': {'radius': cell.tip_radius} if cell.tip_radius else {},
    }
    return {key: value for key, value in entries.items() if value}
