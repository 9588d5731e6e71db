"""The tests of a model: whether its residual is noise, and whether anything exceeds its declared uncertainty."""

from __future__ import annotations

from typing import NamedTuple

from scipy import special

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis import noise_advice
from scara_kinetostatic.diagnosis.candidates import CandidateSet
from scara_kinetostatic.diagnosis.contact_angle import off_normal_p_value, with_free_off_normal_angles
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence, find_dependences
from scara_kinetostatic.diagnosis.linear_problem import Problem, pose_problem
from scara_kinetostatic.diagnosis.ranking import significance
from scara_kinetostatic.diagnosis.search import all_candidates
from scara_kinetostatic.diagnosis.thresholds import SIGNIFICANCE
from scara_kinetostatic.diagnosis.trusted import shares
from scara_kinetostatic.effects.base import Effect


class Adequacy(NamedTuple):
    """The test of a model.

    Attributes:
        p_value: of "it is complete", Bonferroni-corrected over all tests but those of the next.
        dependences: what the residual depends on, significant ones only, the most significant first.
        declared_p_value: of "nothing exceeds its declared uncertainty", Bonferroni-corrected; None without any.
    """

    p_value: float
    dependences: tuple[Dependence, ...]
    declared_p_value: float | None = None


def adequacy(
    calibration: Calibration, problem: Problem | None = None, candidate_set: CandidateSet | None = None
) -> Adequacy:
    """Test a model against all that its residual could depend on.

    Args:
        calibration: with or without effects.
        problem: its linear problem.
        candidate_set: effects to test as well; None for none.
    """
    c = calibration
    dependences, declared = list(find_dependences(with_free_off_normal_angles(c))), list[Dependence]()
    if problem is not None and candidate_set is not None:
        best_first = {candidate.effect.label: candidate for candidate in reversed(candidate_set.candidates)}
        for candidate in best_first.values():
            tested = Dependence(candidate.effect.title, *significance(problem, candidate))
            (declared if problem.is_declared(candidate.effect) else dependences).append(tested)
    given = c.noise_source == 'given'
    if not given and problem is not None and c.prior_cost:
        beyond = float(special.chdtrc(len(c.errors) + c.trusted, c.prior_cost))
        declared.append(Dependence('errors beyond what is declared', beyond, c.prior_cost / c.chi_square))
    size = float(special.chdtrc(c.degrees_of_freedom, c.chi_square)) if given else 1.0
    tests = max(len(dependences) + given, 1)
    smallest = tests * min([size, *(item.p_value for item in dependences)])
    counted = [(item, tests) for item in dependences] + [(item, len(declared)) for item in declared]
    significant = [item for item, number in counted if item.p_value * number < SIGNIFICANCE]
    return Adequacy(
        min(1.0, smallest),
        tuple(sorted(significant, key=lambda item: item.p_value)),
        len(declared) * min(item.p_value for item in declared) if declared else None,
    )


class BaseTests(NamedTuple):
    """The tests of the base model.

    Attributes:
        problem: its linear problem.
        candidate_set: every effect by itself.
        p_value: of "the base model is complete".
        dependences: what its residual depends on significantly.
        off_normal_p_value: of "the off-normal angles are noise".
        implausible_noise: why estimated noise is too large to be noise; else empty.
    """

    problem: Problem
    candidate_set: CandidateSet
    p_value: float
    dependences: tuple[Dependence, ...]
    off_normal_p_value: float
    implausible_noise: str

    @property
    def alarm(self) -> bool:
        """Whether the base model is not complete."""
        return self.p_value < SIGNIFICANCE or bool(self.implausible_noise)


def examine_base_model(c: Calibration, known: tuple[Effect, ...]) -> BaseTests:
    """The tests of the base model.

    Where uncertainties are declared, half of the false alarms that are accepted are those of tests of what they are
    about (weighted Bonferroni: Genovese, Roeder and Wasserman, Biometrika 93 (2006) 509).
    """
    problem = pose_problem(c)
    candidate_set = all_candidates(c, problem, known, together=False)
    fit = adequacy(c, problem, candidate_set)
    off_normal = off_normal_p_value(c)
    halves = 2 if fit.declared_p_value is not None or c.trusted else 1
    declared = 1.0 if fit.declared_p_value is None else fit.declared_p_value
    p_value = min(1.0, 2 * halves * min(fit.p_value, off_normal), halves * max(shares(c), 1) * declared)
    return BaseTests(problem, candidate_set, p_value, fit.dependences, off_normal, noise_advice.implausible_noise(c))
