"""One thread for linear algebra within public calls and in processes of the package; none of these tests takes time."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, Event
from types import FunctionType

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import scara_kinetostatic as sk
from scara_kinetostatic.assessment import outcome as outcomes
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.threads import one_thread

WAIT = 60.0
PUBLIC = [name for name in sorted(sk._homes()) if isinstance(getattr(sk, name), FunctionType)]


def threads() -> set[int]:
    """The numbers of threads of all libraries of linear algebra."""
    return {library['num_threads'] for library in threadpool_info() if library['user_api'] == 'blas'}


class Probe:
    """An argument that notes the number of threads when it becomes an array."""

    def __init__(self, values: list[list[float]]) -> None:
        self.values, self.seen = values, set[int]()

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        self.seen |= threads()
        return np.array(self.values)


@pytest.fixture(params=[2, 4, 8])
def asked_for(request):
    """More threads, as the caller has them."""
    with threadpool_limits(request.param, user_api='blas'):
        yield request.param


@pytest.fixture(scope='module')
def touches() -> sk.TouchSet:
    return sk.simulate(PAPER_CELL, {'l1': 0.3302}, per_disc=6)


def test_a_public_call_has_one_thread_and_its_caller_what_he_had(asked_for, touches):
    joints = Probe([[0.8, 2.1]])
    sk.locate(sk.calibrate(touches, PAPER_CELL), joints)
    assert joints.seen == {1}
    assert threads() == {asked_for}
    with pytest.raises(sk.InputError):
        sk.compensate(sk.calibrate(touches, PAPER_CELL), Probe([[0.8]]))
    assert threads() == {asked_for}


@pytest.mark.parametrize('name', PUBLIC)
def test_every_public_function_has_one_thread(name):
    function = getattr(sk, name)
    assert function.__wrapped__.__name__ == name
    assert pickle.loads(pickle.dumps(function)) is function


def test_what_an_outcome_works_out_when_asked_has_one_thread(asked_for, touches, monkeypatch):
    outcome, seen = sk.diagnose(touches, PAPER_CELL), []
    real = outcomes.assess
    monkeypatch.setattr(outcomes, 'assess', lambda evidence: (seen.append(threads()), real(evidence))[1])
    assert outcome.assessment.grade.value in ('fit', 'caution')
    assert seen == [{1}] and threads() == {asked_for}
    for name in ('comparison', 'leverages', 'tip_uncertainty', 'object_left_out', 'budget'):
        assert hasattr(vars(Evidence)[name].func, '__wrapped__'), name


def test_calls_that_overlap_end_with_the_number_before_the_first(asked_for):
    both, first_ended, seen = Barrier(2), Event(), []

    @one_thread
    def first():
        both.wait(WAIT)

    @one_thread
    def second():
        both.wait(WAIT)
        assert first_ended.wait(WAIT)
        seen.append(threads())

    with ThreadPoolExecutor(2) as pool:
        later = pool.submit(second)
        pool.submit(first).result(WAIT)
        first_ended.set()
        later.result(WAIT)
    assert seen == [{1}] and threads() == {asked_for}
    ThreadPoolExecutor(1).submit(one_thread(lambda: seen.append(threads()))).result(WAIT)
    assert seen == [{1}, {1}] and threads() == {asked_for}


def test_warnings_show_the_line_of_the_caller(touches):
    cell = PAPER_CELL
    drifting = sk.simulate(cell, {'l1': 0.3302}, effects='thermal_drift[joint1]:rate=1e-6', per_disc=18)
    outcome = sk.diagnose(drifting, cell)
    assert 'thermal_drift[joint1]' in outcome.effects
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter('always')
        sk.locate(outcome, [0.8, 2.1])
    assert {item.filename for item in shown} == {__file__}


STAND_IN = """
import sys
from types import SimpleNamespace
import {module} as module
def show(*_):
    import scipy.linalg
    from threadpoolctl import threadpool_info
    found = {{library['num_threads'] for library in threadpool_info() if library['user_api'] == 'blas'}}
    print(found, file=sys.stderr)
    return {{}}
"""
PROCESSES = {
    'node': (
        'scara_kinetostatic.nodes.executables',
        'sys.modules["scara_kinetostatic.nodes.runtime"] = SimpleNamespace(run=lambda _: show() or 0)\n'
        'module.compensator()',
    ),
    'job': (
        'scara_kinetostatic.nodes.calibration_job',
        'module.do = show; sys.argv[1:] = [\'{"recordings": [], "cell": "", "fixed": [], "left_out": [], "output": "", '
        '"publish_unfit": false}\']\nmodule.main()',
    ),
    'command': ('scara_kinetostatic.cli.main', 'module.main = lambda: show() and 0\nmodule.command()'),
}


@pytest.mark.parametrize(('process', 'asked'), [*((name, '4') for name in PROCESSES), ('command', '2'), ('node', '8')])
def test_a_process_has_one_thread(process, asked):
    """Whatever its environment asks for."""
    module, run = PROCESSES[process]
    environment = os.environ | {'OPENBLAS_NUM_THREADS': asked, 'OMP_NUM_THREADS': asked}
    code = STAND_IN.format(module=module) + run
    ended = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, env=environment)
    assert ended.stderr == '{1}\n'
