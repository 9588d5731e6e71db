"""Requirements and result of an optimal design."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from scara_kinetostatic.model.cell import Plate
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import PER_DISC
from scara_kinetostatic.studies.design.disc_placement import DiscMap, Layout
from scara_kinetostatic.studies.design.prediction import Robot
from scara_kinetostatic.studies.design.selection import SetCheck
from scara_kinetostatic.studies.design.sensitivity import Curve, Row
from scara_kinetostatic.studies.design.workspace import Region, Tip, TipStd, Workspace

_EVERYWHERE = Region()


USUAL_ACCURACY = 1e-5
"""Largest standard deviation of the tip where none is required, m."""


class AccuracySource(str, Enum):
    """Where the accuracy comes from that a design has to reach."""

    REQUIRED = 'required'
    TOLERANCE = 'tolerance'
    USUAL = 'usual'
    ATTAINABLE = 'attainable'


@dataclass(frozen=True)
class Requirements:
    """What the design has to reach, and what it may choose from.

    Attributes:
        accuracy: largest standard deviation of the tip over the workspace, m.
        accuracy_source: where that comes from.
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

    accuracy: float = USUAL_ACCURACY
    accuracy_source: AccuracySource = AccuracySource.REQUIRED
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
    """The smallest set of touches found for the required accuracy, with checks or without.

    Attributes:
        plan: the touches, in the order in which to make them.
        row: their prediction.
        check: checks of the set.
        tried: largest standard deviation of the tip of the best smaller sets, by number of touches, m; of those that
            check themselves that after the worst loss, infinite where a leverage is too large.
        least: lower bound of the number of touches.
        value: largest standard deviation of the tip, m; of a set that checks itself that after the worst loss.
    """

    plan: Plan
    row: Row
    check: SetCheck
    tried: dict[int, float]
    least: int
    value: float


class DiscUse(NamedTuple):
    """How the recommended set uses a disc of the cell.

    Attributes:
        name: of the disc.
        touches: number of touches on it.
        candidates: number of touches on it that could be chosen.
    """

    name: str
    touches: int
    candidates: int


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
        robot: the robot with its cell; with all discs on one plate, in the frame of that plate.
        requirements: of the design.
        workspace: where the tip is evaluated.
        recommended: the smallest set that reaches the accuracy and checks itself: it keeps the accuracy after the loss
            of any one touch, no leverage is too large, and every disc is touched.
        smallest: the smallest set that reaches the accuracy; it may check nothing.
        curve: accuracy by the number of touches.
        tables: predictions by what is varied: ``levels``, ``postures``, ``discs``, ``radius``.
        placed: new layouts of one disc, two, ….
        additional_disc: accuracy with one additional disc.
        tip: of which the accuracy is required, over the workspace.
        plate: in whose frame the tip is, because it carries all discs; None for the base frame.
        discs: how the recommended set uses the discs of the cell.
        least_possible: largest standard deviation of the tip that very many touches leave (`attainable`), m; 0 where
            the cell declares no uncertainties.
        in_base_frame: that of the recommended set in the base frame, m; None where no plate stands between.
    """

    robot: Robot
    requirements: Requirements
    workspace: Workspace
    recommended: DesignedSet
    smallest: DesignedSet
    curve: Curve
    tables: dict[str, list[Row]]
    placed: tuple[PlacedDiscs, ...]
    additional_disc: DiscMap
    tip: Tip
    plate: Plate | None = None
    discs: tuple[DiscUse, ...] = ()
    least_possible: float = 0.0
    in_base_frame: float | None = None

    def tip_of(self, designed: DesignedSet) -> TipStd:
        """Standard deviation of the tip of which the accuracy is required, with a set."""
        return designed.row.loaded if self.requirements.under_load else designed.row.free
