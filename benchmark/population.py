"""Robots with every small error at once: whether the stated uncertainty of the tip holds, and how wide it is.

    python -m benchmark.population [--robots N] [--first N] [--sizes 0 0.3 1 3] [--kind all|outside] [--cell NAME]
                                   [--effects estimated|typical|none] [--jobs N] [--json FILE]

A robot has every error of the catalogue and eight from outside it, each normal with its size below times a factor. Of
the kind ``outside`` half of its errors are from outside: of those of the catalogue as many as there are others. All
are simulated by the laws of the arm, not linearised. The touches are 108 in two cells, with the noise not stated and
estimated; the discs' uncertainty is declared or not.

Judged is the tip that `locate` gives at places all over the workspace, under the mean force in any direction, by the
true tip there: the part of the places where it is within the 95 % ellipse, and the stated uncertainty over the error.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any, ClassVar, NamedTuple

import numpy as np

from benchmark.common import in_processes, parser, print_targets, save
from benchmark.diagnosis.cells import NOISE, SETUPS, Setup, seed_of
from benchmark.diagnosis.unlisted import OvalDisc
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import workspace
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.effects.base import Effect, JointEffect, LinearEffect, SensorEffect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import Parameter, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import World

FACTORS = (0.0, 0.3, 1.0, 3.0)
DECLARED = 1e-5
"""Standard uncertainty of each coordinate of a disc's centre, times the factor, m; half of it of its radius."""
PLACES = 200
"""Poses at which the tip is judged."""
SIZES: dict[str, float | tuple[float, ...]] = {
    'contact_friction': 0.004,
    'sensor_rotation': 2e-3,
    'sensor_bias': 0.05,
    'sensor_nonlinearity': 1e-4,
    'sensor_cross_talk': 2e-3,
    'encoder_gain': 2e-5,
    'transmission_error[joint1]': 2e-5,
    'transmission_error[joint2]': 1e-5,
    'joint_hardening': 2e-9,
    'joint_hysteresis': 1e-5,
    'joint_slip': 5e-7,
    'anisotropic_gripper': 2e-7,
    'anisotropic_backlash': 3e-6,
    'link_bending': 4e-7,
    'base_compliance': 1e-7,
    'base_tilt': 0.02,
    'contact_compliance': 3e-7,
    'object_position': 1e-5,
    'plate_position': 1e-5,
    'object_radius': 5e-6,
    'thermal_drift[joint1]': 1e-8,
    'thermal_drift[joint2]': 1e-8,
    'thermal_drift': 1e-8,
    'shift[sensor]': 0.03,
    'shift[joint1]': 5e-6,
    'shift[joint2]': 5e-6,
    'shift': 3e-6,
    'tip_shape': 5e-6,
    'joint_leak': 2e-5,
    'joint_coupling': 2e-5,
    'cable': 0.05,
    'cable_pull': 0.05,
    'object_friction': 0.004,
}
"""Size of each error of the catalogue by label or name: its standard deviation at the factor 1, SI. Those of a robot
arm and a cell in a workshop: gears of 4 arcsec, discs measured to 10 µm, a base on a steel frame.
"""
CYCLES = (1.0, 2.0, 3.0, 4.0, 11.0, 36.0, 100.0)
"""Waves per turn of a transmission error: eccentric, oval and bent wheels, teeth."""


class _Outside:
    """Texts of an error that the catalogue does not have."""

    confounded_with = identified_by = 'not examined'
    plot_variable = 'angle'
    statement = 'outside the catalogue'


@dataclass(frozen=True)
class StiffnessRipple(_Outside, JointEffect):
    """The compliance of a joint changes as it turns: δ = c (a cos 2q + b sin 2q)."""

    name: ClassVar[str] = 'stiffness_ripple'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('a', 'rad/Nm', 1e-4, 'cosine'),
        Parameter('b', 'rad/Nm', 1e-4, 'sine'),
    )

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """Two waves per turn."""
        torque, angle = at.torques[:, self.joint], at.joints[:, self.joint]
        return torque * np.cos(2 * angle), torque * np.sin(2 * angle)


@dataclass(frozen=True)
class WarmUp(_Outside, JointEffect):
    """The zero of a joint approaches its warm place: δ = -angle (1 - exp(-t / 150 s))."""

    name: ClassVar[str] = 'warm_up'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('angle', 'rad', 1e-3, 'in the end'),)

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """Exponential in time."""
        return (-(1 - np.exp(-at.metadata.time / 150.0)),)


@dataclass(frozen=True)
class RunOut(_Outside, LinearEffect):
    """The axis of joint 1 is no point: d = a (cos 2q1, 0) + b (0, sin 2q1)."""

    name: ClassVar[str] = 'run_out'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('a', 'm', 1e-3, 'x'), Parameter('b', 'm', 1e-3, 'y'))

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        """An ellipse twice per turn."""
        c, s, none = np.cos(2 * at.joints[:, 0]), np.sin(2 * at.joints[:, 0]), np.zeros(len(at.joints))
        return Shift(place=np.stack([c, none], axis=1)), Shift(place=np.stack([none, s], axis=1))


@dataclass(frozen=True)
class GripperHardening(_Outside, LinearEffect):
    """The gripper yields less the more it is loaded: d = rate ‖F‖ F."""

    name: ClassVar[str] = 'gripper_hardening'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('rate', 'm/N²', 1e-6, 'of the yield'),)

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        """A square of the force."""
        return (Shift(place=at.magnitude[:, None] * at.force),)


@dataclass(frozen=True)
class SoftBacklash(_Outside, JointEffect):
    """A joint's teeth yield at their edges: δ = angle tanh(c / 2 Nm), beside its backlash."""

    name: ClassVar[str] = 'soft_backlash'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('angle', 'rad', 1e-3, 'in the end'),)

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """A smooth step over the torque."""
        return (np.tanh(at.torques[:, self.joint] / 2.0),)


@dataclass(frozen=True)
class CrossWave(_Outside, JointEffect):
    """A wave of a gear that both joints drive: δ = a sin(q1 + 2 q2)."""

    name: ClassVar[str] = 'cross_wave'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('a', 'rad', 1e-3, 'largest'),)

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """Over the sum of the angles."""
        return (np.sin(at.joints @ np.array([1.0, 2.0])),)


@dataclass(frozen=True)
class SensorLobes(_Outside, SensorEffect):
    """The force sensor has three lobes: e = a ‖F‖ (cos 3φ, sin 3φ) in its frame."""

    name: ClassVar[str] = 'sensor_lobes'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('a', '1', 0.05, 'part of the force'),)

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        """Third harmonic."""
        angle = 3 * np.arctan2(force[:, 1], force[:, 0])
        return values[0] * np.hypot(*force.T)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


OUTSIDE = {
    'oval_disc': 5e-6,
    'stiffness_ripple': 3e-7,
    'warm_up': 5e-6,
    'run_out': 5e-6,
    'gripper_hardening': 2e-9,
    'soft_backlash': 1e-5,
    'cross_wave': 1e-5,
    'sensor_lobes': 1e-3,
}
"""The eight kinds of error from outside the catalogue, with their sizes as `SIZES`."""


def outside(cell: Cell) -> list[Effect]:
    """The errors from outside the catalogue."""
    joint_effects = (StiffnessRipple, WarmUp, SoftBacklash)
    return [
        *(OvalDisc.of(k, disc.name) for k, disc in enumerate(cell.discs)),
        *(kind.of(joint) for kind in joint_effects for joint in (0, 1)),
        CrossWave.of(1),
        RunOut(),
        GripperHardening(),
        SensorLobes(),
    ]


class Task(NamedTuple):
    """One robot."""

    cell: str
    kind: str
    factor: float
    declared: bool
    effects: str
    seed: int


def draw(task: Task) -> tuple[Setup, ExtendedModel, TouchSet]:
    """A cell as it is described, its robot with all its errors, and the touches that this makes."""
    setup, factor = SETUPS[task.cell], task.factor
    random = np.random.default_rng([task.seed, seed_of(task.cell, task.kind, factor)])
    truth = setup.truth
    described = setup.cell
    if task.declared:
        discs = tuple(d._replace(center_std=factor * DECLARED, radius_std=factor * DECLARED / 2) for d in described.discs)
        described = replace(described, discs=discs)
    listed, others = [e for e in catalogue(setup.cell) if e.parameters], outside(setup.cell)
    if task.kind == 'outside':
        kept = random.permutation(len(listed))[: len(others)]
        listed = [listed[k] for k in sorted(kept)]
    effects, values = [], []
    for effect in (*listed, *others):
        size = {**SIZES, **OUTSIDE}.get(effect.label, {**SIZES, **OUTSIDE}.get(effect.name))
        if size is None:
            continue
        signs = np.array([p.sign for p in effect.parameters])
        drawn = factor * size * random.standard_normal(len(signs))
        drawn = np.where(signs == 0, drawn, signs * np.abs(drawn))
        if effect.name == 'transmission_error':
            drawn = np.array([drawn[0], random.uniform(0, 2 * np.pi), random.choice(CYCLES)])
        elif effect.name == 'joint_slip':
            drawn[1] = random.uniform(1.0, 4.0)
        elif effect.is_stepwise:
            drawn[-1] = random.integers(10, 98) + 0.5
        effects.append(effect)
        values.append(tuple(drawn.tolist()))
    robot = ExtendedModel(truth, tuple(effects), tuple(values)) if factor else ExtendedModel(truth)
    touches = simulate_touches(setup.cell, robot, setup.plan, NOISE, int(random.integers(2**31)))
    return setup._replace(cell=replace(described, noise=None)), robot, touches


def judge(final: Calibration, robot: ExtendedModel, seed: int) -> dict[str, float]:
    """How well the tip is known at places all over the workspace."""
    random, area = np.random.default_rng([seed, 7]), workspace(final)
    rows = random.choice(len(area.poses.joints), PLACES, replace=False)
    joints, force, posture = area.poses.joints[rows], area.poses.force[rows], area.poses.posture[rows]
    metadata = TouchMetadata.plain(len(rows))._replace(posture=posture)
    found = Predictor(final.arm).locate(joints, force, metadata)
    noise = final.contributions[0].covariance
    size = len(noise)
    plain = replace(final.arm, covariance=noise) if size == len(final.arm.covariance) else None
    by_noise = None if plain is None else Predictor(plain).locate(joints, force, metadata).covariance
    true, _ = direct_kinetostatics(robot, joints, force, final.cell.gripper, metadata)
    error = found.position - true
    known = np.isfinite(found.covariance[:, 0, 0]) & found.loaded
    square = np.einsum('ni,ni->n', error, np.linalg.solve(found.covariance[known_or(known)], error[known_or(known)][..., None])[..., 0]) if known.all() else _squares(error, found.covariance, known)
    stated = np.sqrt(np.trace(found.covariance, axis1=1, axis2=2))
    noise_only = np.nan if by_noise is None else float(np.nanmedian(stated[known]) / np.nanmedian(np.sqrt(np.trace(by_noise, axis1=1, axis2=2))[known]))
    return {
        'coverage': float(np.mean(square[known] <= 5.991)) if known.any() else np.nan,
        'known': float(known.mean()),
        'error': float(np.median(np.linalg.norm(error, axis=1)[known])) if known.any() else np.nan,
        'stated': float(np.median(stated[known])) if known.any() else np.nan,
        'ratio': float(np.sqrt(np.mean(stated[known] ** 2) / np.mean((error[known] ** 2).sum(axis=1)))) if known.any() else np.nan,
        'over_noise': noise_only,
    }


def known_or(known):
    return known


def _squares(error: Floats, covariance: Floats, known) -> Floats:
    square = np.full(len(error), np.nan)
    square[known] = np.einsum('ni,ni->n', error[known], np.linalg.solve(covariance[known], error[known][..., None])[..., 0])
    return square
