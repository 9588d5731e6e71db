"""Physical effects that the base model lacks, by what they are of; `registry` lists them.

To write one, derive from `JointEffect`, `DiscEffect`, `SensorEffect`, `LinearEffect` or `Effect`.
"""

from scara_kinetostatic.effects.base import VARIABLES as VARIABLES
from scara_kinetostatic.effects.base import DiscEffect as DiscEffect
from scara_kinetostatic.effects.base import Effect as Effect
from scara_kinetostatic.effects.base import JointEffect as JointEffect
from scara_kinetostatic.effects.base import LinearEffect as LinearEffect
from scara_kinetostatic.effects.base import PlotAxis as PlotAxis
from scara_kinetostatic.effects.base import SensorEffect as SensorEffect
from scara_kinetostatic.effects.base import Trial as Trial
from scara_kinetostatic.effects.base import at_joint as at_joint
from scara_kinetostatic.effects.registry import catalogue as catalogue
from scara_kinetostatic.effects.registry import find as find
from scara_kinetostatic.effects.registry import register as register
from scara_kinetostatic.effects.registry import unregister as unregister
from scara_kinetostatic.effects.unnamed import empirical_effects as empirical_effects
from scara_kinetostatic.model.extended_model import ForceDependence as ForceDependence
from scara_kinetostatic.model.extended_model import Parameter as Parameter
from scara_kinetostatic.model.extended_model import Shift as Shift
from scara_kinetostatic.model.extended_model import TouchState as TouchState
