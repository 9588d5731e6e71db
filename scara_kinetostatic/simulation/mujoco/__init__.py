"""A cell in an independent physics engine, MuJoCo: bodies, springs, friction, contact; none of our formulas of the arm.

`scene` says what is built, `mjcf` builds it of bodies, `engine` moves it, `player` plays the touches of a plan on it
(`played`), `recorded` is what the sensors make of that; `truth` tells what was built. MuJoCo comes with the extra
`physics` and is imported when the engine starts.
"""

from __future__ import annotations

from scara_kinetostatic.simulation.mujoco.recorded import play, play_touches
from scara_kinetostatic.simulation.mujoco.scene import SCENES, Scene, scene_named

__all__ = ['SCENES', 'Scene', 'play', 'play_touches', 'scene_named']
