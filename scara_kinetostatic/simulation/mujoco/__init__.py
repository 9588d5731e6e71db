"""A cell in the physics engine MuJoCo: bodies, springs, friction and contact, independent of this package's model.

`engine` describes the robot, builds it of bodies by the template `scene.xml.j2` and integrates it, `streams` makes the
touches of a plan, applies the sensors and states the truth. MuJoCo comes with the extra `physics` and is
imported when the engine starts.
"""

from __future__ import annotations

from scara_kinetostatic.simulation.mujoco.engine import SCENES, Scene, scene_named
from scara_kinetostatic.simulation.mujoco.streams import simulate_streams

__all__ = ['SCENES', 'Scene', 'scene_named', 'simulate_streams']
