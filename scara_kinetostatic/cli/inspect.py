"""List the touches of a recording.

Lists the contents of a recording: its topics with their rates and gaps, and
every touch that is found: time and duration of the hold, object, elbow posture,
size and direction of the force, and for a rejected touch the reason.

Example:
  scara-kinetostatic inspect recording --cell cell.yaml
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scara_kinetostatic.cli.shared_arguments import JSON, MAX_BYTES, cell_option, print_result

if TYPE_CHECKING:
    from scara_kinetostatic.model.cell import Cell
    from scara_kinetostatic.touches.detection import Detection


ARGUMENTS = (
    ('bag', 'BAG', Path, 'the recording, or a touch table (.csv)'),
    cell_option('the one in the recording'),
    MAX_BYTES,
    JSON,
)


def run(args: argparse.Namespace) -> None:
    """Inspects.

    Raises:
        InputError: the recording or the cell cannot be read or is invalid.
    """
    from scara_kinetostatic.bags.decoding import reading
    from scara_kinetostatic.bags.reader import open_recording, read_streams, recorded_cell
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.files.tables import is_touch_table
    from scara_kinetostatic.model.parameters import NANO
    from scara_kinetostatic.pipeline import gather_touches
    from scara_kinetostatic.touches.detection import cell_of_files, find_touches

    cell = load_cell(args.cell) if args.cell else recorded_cell([args.bag], '--cell')
    warnings: tuple[str, ...] = ()
    found: dict[str, Any] = {'recording': str(args.bag), 'topics': [], 'streams': {}}
    if is_touch_table(args.bag):  # it has no streams
        detection, cell = gather_touches([args.bag], cell), cell_of_files(cell, [args.bag])
    else:
        streams = read_streams(args.bag, cell)
        detection, warnings = find_touches(streams, cell), streams.warnings
        with reading(args.bag):
            source = open_recording(args.bag)
            for _ in source.batches(()):
                pass
            topics = sorted((topic.name, topic.msgtype) for topic in source.topics())
        found['topics'] = [{'name': name, 'type': kind} for name, kind in topics]
        stamps = streams.joints.stamp, streams.wrench.stamp
        for name, stamp in zip(streams.topics or cell.sensor.topics, stamps, strict=True):
            duration, gaps = NANO * float(stamp[-1] - stamp[0]), NANO * (stamp[1:] - stamp[:-1])
            found['streams'][name] = {
                'messages': len(stamp),
                'duration': duration,
                'rate': (len(stamp) - 1) / duration if duration > 0 else 0.0,
                'longest_gap': float(gaps.max()) if len(gaps) else 0.0,
            }
        found |= {'turned': streams.turned} if streams.turned else {}
    found |= {'warnings': [*warnings, *detection.warnings], 'touches': _touches(detection, cell)}
    print_result(_as_text(found), args.bag, {}, found if args.json else None)


def _touches(detection: Detection, cell: Cell) -> list[dict[str, Any]]:
    """One entry per touch, accepted or not, in the order of time."""
    from scara_kinetostatic.calibration.fit_point import base_force
    from scara_kinetostatic.calibration.observations import observe
    from scara_kinetostatic.model.extended_model import ExtendedModel

    touches = detection.touches
    force = base_force(observe(touches, cell), ExtendedModel(cell.nominal))
    place, rows = {int(index): k for k, index in enumerate(touches.index)}, []
    for episode in detection.episodes:
        time, hold = sum(episode.hold) / 2, episode.hold[1] - episode.hold[0]
        row: dict[str, Any] = {'index': episode.index, 'time': time, 'hold': hold, 'accepted': not episode.reason}
        if (k := place.get(episode.index)) is not None:
            row |= {'object': cell.discs[touches.disc[k]].name, 'posture': touches.posture[k], 'force': force[k]}
        rows.append(row | {'reason': episode.reason})
    return rows


def _as_text(found: dict[str, Any]) -> str:
    from scara_kinetostatic.model.quantities import count
    from scara_kinetostatic.report.page import Table

    topics: list[tuple[str, ...]] = []
    for topic in found['topics']:
        stream = found['streams'].get(topic['name'])
        keys = (('messages', 'd'), ('duration', '.1f'), ('rate', '.1f'), ('longest_gap', '.3f'))
        numbers = [format(stream[key], digits) for key, digits in keys] if stream else ['–'] * len(keys)
        topics.append((topic['name'], topic['type'], *numbers))
    touches: list[tuple[str, ...]] = []
    for touch in found['touches']:
        what: tuple[str, ...] = (f'rejected: {touch["reason"]}',)
        if touch['accepted']:
            x, y = touch['force']
            force = (f'{math.hypot(x, y):.2f}', f'{math.degrees(math.atan2(y, x)):.1f}')
            what = (touch['object'], 'left' if touch['posture'] > 0 else 'right', *force)
        touches.append((str(touch['index']), f'{touch["time"]:.1f}', f'{touch["hold"]:.2f}', *what))
    of_topics = ('topic', 'type', 'messages', 'duration', 'rate', 'longest gap'), ('', '', '', 's', 'Hz', 's')
    of_touches = (
        ('touch', 'time', 'hold', 'object', 'posture', 'force', 'direction'),
        ('', 's', 's', '', '', 'N', 'deg'),
    )
    accepted = sum(touch['accepted'] for touch in found['touches'])
    parts = [
        found['recording'],
        *([Table(*of_topics, tuple(topics)).text()] if topics else []),
        Table(*of_touches, tuple(touches)).text() if touches else 'no contact in the recording',
        f'{count(len(touches), "touch", "touches")} found: {accepted} accepted, {len(touches) - accepted} rejected',
    ]
    notes = [*([found['turned']] if 'turned' in found else []), *found['warnings']]
    return '\n'.join(['\n\n'.join(parts), *(f'note: {note}' for note in notes)])
