"""`scara-kinetostatic inspect`: what a recording holds, before it is calibrated."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scara_kinetostatic.cli.arguments import Subparsers, add_verb
from scara_kinetostatic.cli.calibrate import find_cell

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from scara_kinetostatic.model.cell import Cell
    from scara_kinetostatic.touches.detection import Detection
    from scara_kinetostatic.touches.streams import Streams

DESCRIPTION = """\
Shows what a recording holds: its topics, rates and gaps, and every touch that
is found in it: when, which disc, which posture of the elbow, how hard, from where,
how long it was held, and, where it cannot be used, why not.
"""
EXAMPLE = """\
  scara-kinetostatic inspect recording --cell cell.yaml
"""


def add_parser(subparsers: Subparsers[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Adds the verb."""
    parser = add_verb(subparsers, 'inspect', 'show the touches that a recording holds', DESCRIPTION, EXAMPLE, run)
    parser.add_argument('bag', type=Path, metavar='BAG', help='the recording, or a touch table (.csv)')
    parser.add_argument(
        '--cell', type=Path, metavar='FILE', help='cell description; default: the one that the recording carries'
    )
    parser.add_argument('--json', action='store_true', help='the same as JSON')
    return parser


def run(args: argparse.Namespace) -> int:
    """Inspects.

    Raises:
        InputError: the recording or the cell cannot be read, or makes no sense.
    """
    from scara_kinetostatic.bags.reader import read_streams
    from scara_kinetostatic.files.touch_table import is_touch_table, load_touch_table
    from scara_kinetostatic.touches.detection import find_touches
    from scara_kinetostatic.touches.table import in_base_frame, touches_of_table

    cell = find_cell(args.cell, [args.bag])
    if is_touch_table(args.bag):
        detection = touches_of_table(load_touch_table(args.bag), cell)
        found = inspection(args.bag, None, detection, in_base_frame(cell))
    else:
        streams = read_streams(args.bag, cell)
        found = inspection(args.bag, streams, find_touches(streams, cell), cell)
    print(json.dumps(found, indent=2, ensure_ascii=False, allow_nan=False) if args.json else _as_text(found))
    return 0


def inspection(bag: Path, streams: Streams | None, detection: Detection, cell: Cell) -> dict[str, Any]:
    """What was found, as plain JSON values; times in s since the first stamp, forces in N in the base frame.

    A table of touches has no streams.
    """
    return {
        'recording': str(bag),
        'topics': [{'name': name, 'type': kind} for name, kind in _topics(bag)] if streams else [],
        'streams': {
            cell.sensor.joint_states: _stream(streams.joints.stamp),
            cell.sensor.wrench: _stream(streams.wrench.stamp),
        }
        if streams
        else {},
        'warnings': [*(streams.warnings if streams else ()), *detection.warnings],
        'touches': _touches(detection, cell),
    }


def _topics(bag: Path) -> list[tuple[str, str]]:
    from scara_kinetostatic.bags.messages import reading
    from scara_kinetostatic.bags.sources import open_recording

    with reading(bag):
        source = open_recording(bag)
        for _ in source.batches(()):
            pass
        return sorted((topic.name, topic.msgtype) for topic in source.topics())


def _stream(stamp: NDArray[np.int64]) -> dict[str, float | int]:
    duration = 1e-9 * float(stamp[-1] - stamp[0])
    gaps = 1e-9 * (stamp[1:] - stamp[:-1])
    return {
        'messages': len(stamp),
        'duration': duration,
        'rate': (len(stamp) - 1) / duration if duration > 0 else 0.0,
        'longest_gap': float(gaps.max()) if len(gaps) else 0.0,
    }


def _touches(detection: Detection, cell: Cell) -> list[dict[str, Any]]:
    """One entry per touch, accepted or not, in the order of time."""
    from scara_kinetostatic.calibration.prediction import base_force, observe
    from scara_kinetostatic.model.extended_model import ExtendedModel

    touches = detection.touches
    force = base_force(observe(touches, cell), ExtendedModel(cell.nominal))
    accepted = {
        int(touches.index[k]): {
            'object': cell.discs[touches.disc[k]].name,
            'posture': int(touches.posture[k]),
            'force': force[k].tolist(),
        }
        for k in range(len(touches))
    }
    return [
        {
            'index': episode.index,
            'time': float(episode.hold[0] + episode.hold[1]) / 2,
            'hold': float(episode.hold[1] - episode.hold[0]),
            'accepted': not episode.reason,
            **accepted.get(episode.index, {}),
            'reason': episode.reason,
        }
        for episode in detection.episodes
    ]


def _as_text(found: dict[str, Any]) -> str:
    lines = [found['recording'], '']
    width = max((len(topic['name']) for topic in found['topics']), default=0)
    for topic in found['topics']:
        stream = found['streams'].get(topic['name'])
        numbers = f'  {stream["messages"]:7d} messages, {stream["rate"]:6.1f} Hz, ' if stream else ''
        numbers += f'longest gap {stream["longest_gap"]:.3f} s, {stream["duration"]:.1f} s' if stream else ''
        lines.append(f'{topic["name"]:{width}}  {topic["type"]:32}{numbers}'.rstrip())
    lines += ['', *_table(found['touches'])]
    accepted = sum(touch['accepted'] for touch in found['touches'])
    rejected = len(found['touches']) - accepted
    lines += ['', f'{len(found["touches"])} touches found: {accepted} accepted, {rejected} rejected']
    lines += [f'note: {warning}' for warning in found['warnings']]
    return '\n'.join(lines)


def _table(touches: list[dict[str, Any]]) -> list[str]:
    if not touches:
        return ['no contact in the whole recording']
    width = max([4, *(len(touch.get('object', '')) for touch in touches)])
    lines = [f'touch    time   hold  {"disc":{width}}  posture    force  direction']
    lines.append(f'{"":5}  {"s":>6}  {"s":>5}  {"":{width}}  {"":7}  {"N":>7}  {"deg":>9}')
    for touch in touches:
        start = f'{touch["index"]:5d}  {touch["time"]:6.1f}  {touch["hold"]:5.2f}'
        if touch['accepted']:
            x, y = touch['force']
            posture = 'left' if touch['posture'] > 0 else 'right'
            angle = math.degrees(math.atan2(y, x))
            lines.append(f'{start}  {touch["object"]:{width}}  {posture:7}  {math.hypot(x, y):7.2f}  {angle:9.1f}')
        else:
            lines.append(f'{start}  rejected: {touch["reason"]}')
    return lines
