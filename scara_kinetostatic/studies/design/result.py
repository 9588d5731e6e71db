"""Requirements and result of an optimal design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import PER_DISC
from scara_kinetostatic.studies.design.disc_placement import DiscMap, Layout
from scara_kinetostatic.studies.design.prediction import Robot
from scara_kinetostatic.studies.design.selection import SetCheck
from scara_kinetostatic.studies.design.sensitivity import Curve, Row
from scara_kinetostatic.studies.design.workspace import Region, Workspace

_EVERYWHERE = Region()


@dataclass(frozen=True)
class Requirements:
    """What the design has to reach, and what it may choose from.

    Attributes:
        accuracy: largest standard deviation of the tip over the workspace, m.
        levels: force levels to choose from, N.
        postures: elbow postures to choose from, +1 and -1.
        per_disc: points around a disc to choose from.
        load: force under which the loaded tip is predicted, N.
        under_load: whether the accuracy is required of the loaded tip.
        region: the part of the base frame that counts, and where discs may be placed.
        number: of touches in comparisons.
        radii: smallest and largest radius of a disc that is placed, m; None: as those of the cell.
        most_discs: largest number of discs in new layouts; 0 for no layouts.
        seed: of all random numbers.
    """

    accuracy: float = 1e-5
    levels: tuple[float, ...] = (10.0, 25.0, 40.0)
    postures: tuple[int, ...] = (1, -1)
    per_disc: int = PER_DISC
    load: float = 40.0
    under_load: bool = False
    region: Region = _EVERYWHERE
    number: int = 36
    radii: tuple[float, float] | None = None
    most_discs: int = 3
    seed: int = 0


class DesignedSet(NamedTuple):
    """The smallest set of touches found for the required accuracy.

    Attributes:
        plan: the touches, in the order in which to make them.
        row: their prediction.
        check: checks of the set.
        tried: largest standard deviation of the tip of the best smaller sets, by number of touches, m.
        least: lower bound of the number of touches.
        value: largest standard deviation of the tip, m; of a set with a spare, after the worst loss.
    """

    plan: Plan
    row: Row
    check: SetCheck
    tried: dict[int, float]
    least: int
    value: float


class PlacedDiscs(NamedTuple):
    """A new layout of discs.

    Attributes:
        layout: the discs.
        row: prediction for evenly distributed touches on them.
        needed: number of touches of the smallest set found there for the accuracy, None if it is out of reach.
    """

    layout: Layout
    row: Row | None
    needed: int | None


@dataclass(frozen=True)
class Design:
    """The result.

    Attributes:
        robot: the robot with its cell.
        requirements: of the design.
        workspace: where the tip is evaluated.
        smallest: the smallest set that reaches the accuracy.
        spare: the smallest set that reaches it after the loss of any one touch.
        curve: accuracy by the number of touches.
        tables: predictions by what is varied: ``levels``, ``postures``, ``discs``, ``radius``.
        placed: new layouts of one disc, two, ….
        additional_disc: accuracy with one additional disc.
    """

    robot: Robot
    requirements: Requirements
    workspace: Workspace
    smallest: DesignedSet
    spare: DesignedSet
    curve: Curve
    tables: dict[str, list[Row]]
    placed: tuple[PlacedDiscs, ...]
    additional_disc: DiscMap
