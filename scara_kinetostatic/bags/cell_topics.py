"""Which topics of a recording are those of a cell.

A name with a leading slash is taken as it stands. One without was recorded in the namespace of the nodes, which the
recording shows: `joint_states` is found as `/joint_states` or `/left/joint_states`, both topics in the same namespace.
Where several namespaces have both, nothing says which is meant, and the recording is refused. A collector whose topics
were remapped records a description whose names the recording does not have, beside the only two topics of these types.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from scara_kinetostatic.bags.messages import JOINT_STATE, WRENCH_STAMPED, Topic
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.cell import Sensor

Names = tuple[str, str]


def cell_topics(source: str, topics: Sequence[Topic], sensor: Sensor, recorded: Callable[[], Sensor | None]) -> Names:
    """The names of joint states and wrenches in a recording; those in the root namespace where there is nothing better.

    Args:
        source: the recording, for messages.
        topics: all its topics.
        sensor: of the cell description.
        recorded: reads that of the cell description in the recording; None where there is none.

    Raises:
        RecordingError: several namespaces have both topics.
    """
    here = [[item.name for item in topics if item.msgtype == kind] for kind in (JOINT_STATE, WRENCH_STAMPED)]
    found = _by_namespace(here, sensor)
    if len(found) > 1:
        problem = f'several cells: {" and ".join(f"{joints} with {wrench}" for joints, wrench in found[:4])}'
        remedy = 'write the full names of one, with a leading slash, into sensor.joint_states and sensor.wrench'
        raise RecordingError(source, problem, f'{remedy} of the cell description')
    if found:
        return found[0]
    only = [list(dict.fromkeys(names)) for names in here]
    if any(len(names) != 1 for names in only):
        return sensor.topics
    described = recorded()
    return (only[0][0], only[1][0]) if described and described[:2] == sensor[:2] else sensor.topics


def _by_namespace(here: list[list[str]], sensor: Sensor) -> list[Names]:
    """The pairs of topics of the right types that the names of a cell description can mean."""
    spaces: list[set[str]] = []
    for names, wanted in zip(here, sensor[:2], strict=True):
        if wanted.startswith('/'):
            if wanted not in names:
                return []
        else:
            spaces.append({name[: -len(wanted) - 1] for name in names if name.endswith(f'/{wanted}')})
    common = set.intersection(*spaces) if spaces else {''}
    return [
        tuple(name if name.startswith('/') else f'{space}/{name}' for name in sensor[:2])  # type: ignore[misc]
        for space in sorted(common)
    ]
