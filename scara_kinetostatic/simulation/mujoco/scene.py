"""Scenes: robots in the engine with their effects."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, Parameters
from scara_kinetostatic.simulation.plan import check_numbers

Pair = tuple[float, float]


@dataclass(frozen=True)
class Scene:
    """A robot and its discs as they truly are. All but the first two are 0 where there is no such effect.

    Attributes:
        name: of the scene.
        parameters: L̄ of the arm: lengths, offsets, springs, backlashes.
        contact_friction: Coulomb's coefficient μ between tip and discs.
        bearing_friction: Coulomb friction that opposes the turning of each link, behind its transmission, Nm.
        winding_friction: Coulomb friction inside each transmission, beside its spring, Nm.
        slip_compliance: of a second spring of each transmission, between motor and spring, rad/Nm.
        slip_torque: Coulomb friction beside that second spring, Nm.
        displaced: number of the displaced disc.
        displacement: by how much, m.
        base_compliance: of the springs under the base, along x and y, m/N.
        link_compliance: rotation of the end of link 1, clamped at the other end, per moment, rad/Nm.
        padded: numbers of the discs with a soft coat; a cell with fewer discs counts round, here and above.
        pad: its stiffness, force by depth, N/m, where it is pressed by a depth, m; it is softer where it is
            pressed less.
        tilt: of the base, about its x and y axes, rad.
        masses: of the two links, kg; they matter on a tilted base alone.
        cable: stiffness of a cable that pulls link 2 towards the straight arm, Nm/rad.
        quasi_static: whether a light arm moves slowly, so that inertia hardly loads the joints.

    Raises:
        ParameterError: a robot that cannot be built.
    """

    name: str = 'plain'
    parameters: Parameters = field(default_factory=lambda: PAPER_ACTUAL)
    contact_friction: float = 0.0
    bearing_friction: Pair = (0.0, 0.0)
    winding_friction: Pair = (0.0, 0.0)
    slip_compliance: Pair = (0.0, 0.0)
    slip_torque: Pair = (0.0, 0.0)
    displaced: int = 0
    displacement: Pair = (0.0, 0.0)
    base_compliance: Pair = (0.0, 0.0)
    link_compliance: float = 0.0
    padded: tuple[int, ...] = ()
    pad: Pair = (0.0, 0.0)
    tilt: Pair = (0.0, 0.0)
    masses: Pair = (6.0, 4.0)
    cable: float = 0.0
    quasi_static: bool = False

    def __post_init__(self) -> None:
        where = f'scene {self.name!r}'
        self.parameters.check_physical(where)
        for name in ('p_ee', 'p1', 'p2'):
            if getattr(self.parameters, name) == 0:
                raise ParameterError(f'{where}: {name}', 'expected a compliance above 0', 'a spring needs a stiffness')
        names = [item.name for item in fields(self)]
        check_numbers(where, self, zero=names, signed=('displacement', 'tilt'))
        if any(bool(w) != bool(r) for w, r in zip(self.slip_compliance, self.slip_torque, strict=True)):
            raise ParameterError(f'{where}: slip_torque', 'expected one above 0 for each slip_compliance above 0')
        if self.padded and min(self.pad) <= 0:
            raise ParameterError(f'{where}: pad', f'expected a stiffness and a depth above 0, got {self.pad}')

    def displaced_disc(self, cell: Cell) -> int | None:
        """Number of the displaced disc; None if there is none."""
        return self.displaced % len(cell.discs) if any(self.displacement) else None

    def padded_discs(self, cell: Cell) -> tuple[int, ...]:
        """Numbers of the discs with a coat."""
        return tuple(sorted({number % len(cell.discs) for number in self.padded}))

    def with_parameters(self, parameters: Parameters) -> Scene:
        """The same scene with another arm."""
        return replace(self, parameters=parameters)


SCENES = {
    scene.name: scene
    for scene in (
        Scene('plain'),
        Scene('contact_friction', contact_friction=0.15),
        Scene('joint_friction', bearing_friction=(0.0, 5.0)),
        Scene('winding_friction', winding_friction=(6.0, 6.0), quasi_static=True),
        Scene('joint_slip', slip_compliance=(0.0, 2e-5), slip_torque=(0.0, 4.0), quasi_static=True),
        Scene('joint_slip_fast', slip_compliance=(0.0, 2e-5), slip_torque=(0.0, 4.0)),
        Scene('displaced_disc', displaced=1, displacement=(1.2e-4, -0.9e-4)),
        Scene('base_on_springs', base_compliance=(6e-6, 1e-6)),
        Scene('link_flex', link_compliance=1.5e-4),
        Scene('soft_contact', padded=(0, 1, 2), pad=(7e3, 6e-3)),
        Scene('soft_disc', padded=(1,), pad=(2e5, 2e-4)),
        Scene('tilted_base', tilt=(0.08, -0.06), masses=(15.0, 10.0)),
        Scene('cable', cable=5.0),
        Scene('two', contact_friction=0.15, base_compliance=(6e-6, 1e-6)),
    )
}
"""The scenes by name."""


def scene_named(name: str) -> Scene:
    """A scene by its name.

    Raises:
        ParameterError: there is none of that name.
    """
    if name not in SCENES:
        raise ParameterError('scene', f'there is no {name!r}', f'the names are {" ".join(SCENES)}')
    return SCENES[name]
