"""The recordings bags/engine_*.mcap, made with MuJoCo, and their truth files.

``python -m mujoco_cell.engine_recordings FOLDER TRUTH_FOLDER`` (with ``test`` and the package on the path) makes them
there.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from mujoco_cell.conftest import CELL

from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.simulation.mujoco import Scene, preload_plan, scene_named, simulate_streams, truth_of_scene
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.streams import SensorModel
from scara_kinetostatic.simulation.truth import dump, truth_named

BAGS = Path(__file__).parents[2] / 'bags'
TRUTH = Path(__file__).parents[1] / 'pipeline' / 'truth'
PER_DISC = 14
SENSORS = SensorModel(joint_rate=20.0, wrench_rate=25.0)


class EngineRecording(NamedTuple):
    """A recording, by name, how it was made, whether it leaves out its cell, and points around a disc."""

    name: str
    scene: str
    seed: int
    plain: bool = False
    per_disc: int = PER_DISC

    @property
    def cell(self) -> Cell:
        """What is declared of the cell."""
        return load_cell(BAGS / 'measured.yaml') if self.plain else CELL

    @property
    def robot(self) -> Scene:
        """What is built."""
        return replace(scene_named(self.scene), parameters=truth_named('paper', self.cell).parameters)

    @property
    def plan(self) -> Plan:
        """The touches."""
        return preload_plan(self.cell, self.per_disc)


ALL = (
    EngineRecording('engine_a', 'plain', 201),
    EngineRecording('engine_b', 'contact_friction', 202),
    EngineRecording('engine_c', 'base_on_springs', 203, plain=True),
    EngineRecording('engine_d', 'link_flex', 204),
    EngineRecording('engine_e', 'displaced_disc', 205),
    EngineRecording('engine_f', 'joint_slip', 206, per_disc=6),
)


def make(recording: EngineRecording, folder: Path, truths: Path) -> None:
    """Make one of the recordings in a folder, and its truth in another."""
    one, cell = recording, recording.cell
    streams = simulate_streams(one.robot, cell, one.plan, sensors=SENSORS, seed=one.seed)
    write_streams(folder / f'{one.name}.mcap', streams, cell, compression='zstd', with_cell=not one.plain)
    first = f'# What was built for bags/{one.name}.mcap. Only tests read this.\n'
    text = first + dump(truth_of_scene(one.robot, cell, one.seed))
    (truths / f'{one.name}.yaml').write_text(text, encoding='utf-8')


if __name__ == '__main__':
    for one in ALL:
        make(one, Path(sys.argv[1]), Path(sys.argv[2]))
