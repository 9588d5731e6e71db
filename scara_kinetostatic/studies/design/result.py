"""The design question and its answer, as values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import PER_DISC
from scara_kinetostatic.studies.design.disc_placement import Layout, Map
from scara_kinetostatic.studies.design.prediction import Robot
from scara_kinetostatic.studies.design.selection import Check
from scara_kinetostatic.studies.design.sensitivity import Curve, Row
from scara_kinetostatic.studies.design.workspace import Region, Workspace

EVERYWHERE = Region()


@dataclass(frozen=True)
class Question:
    """What is asked.

    Attributes:
        accuracy: largest standard deviation of the tip over the workspace, m.
        levels: force levels to choose from, N.
        postures: elbow postures to choose from, +1 and -1.
        per_disc: points around a disc to choose from.
        load: force under which the loaded tip is predicted, N.
        under_load: whether the accuracy is asked of the loaded tip.
        region: the part of the base frame that matters, and where discs may stand.
        number: of touches in comparisons.
        radii: least and largest radius of a disc that is placed, m; None: as those of the cell.
        most_discs: layouts of up to so many discs are looked for; 0 for none.
        seed: of everything random.
    """

    accuracy: float = 1e-5
    levels: tuple[float, ...] = (10.0, 25.0, 40.0)
    postures: tuple[int, ...] = (1, -1)
    per_disc: int = PER_DISC
    load: float = 40.0
    under_load: bool = False
    region: Region = EVERYWHERE
    number: int = 36
    radii: tuple[float, float] | None = None
    most_discs: int = 3
    seed: int = 0


class Choice(NamedTuple):
    """A smallest set of touches.

    Attributes:
        plan: the touches, in the order in which to make them.
        row: what they will give.
        check: what speaks for the set.
        tried: what the best sets of smaller numbers reached, by number, m.
        least: proven number of touches below which no set does.
        value: largest standard deviation of the tip that was asked for, m; of a set with a spare, after the worst loss.
    """

    plan: Plan
    row: Row
    check: Check
    tried: dict[int, float]
    least: int
    value: float


class Placed(NamedTuple):
    """Discs placed anew.

    Attributes:
        layout: the discs.
        row: what evenly spread touches on them give.
        needed: number of touches of the smallest set found there for the accuracy, None if it is out of reach.
    """

    layout: Layout
    row: Row | None
    needed: int | None


@dataclass(frozen=True)
class Design:
    """The answer.

    Attributes:
        robot: whom it is for.
        question: what was asked.
        workspace: where the tip is asked for.
        smallest: the smallest set that reaches the accuracy.
        spare: the smallest that still does after any one touch is lost.
        curve: accuracy by the number of touches.
        tables: rows by what is varied: ``levels``, ``postures``, ``discs``, ``radius``.
        placed: discs placed anew, one, two, ….
        map: what one more disc would do.
    """

    robot: Robot
    question: Question
    workspace: Workspace
    smallest: Choice
    spare: Choice
    curve: Curve
    tables: dict[str, list[Row]]
    placed: tuple[Placed, ...]
    map: Map
