"""`paper.json`: the numbers of the reproduction, SI units."""

from __future__ import annotations

from typing import Any

import numpy as np

from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.studies.dial_gauge.document import dial_gauge_document
from scara_kinetostatic.studies.paper.monte_carlo import Scatter
from scara_kinetostatic.studies.paper.study import Reproduction
from scara_kinetostatic.studies.paper.table_2 import ESTIMATED, ESTIMATED_FROM_NOISE, Run

NAME = 'paper.json'


def paper_document(r: Reproduction) -> dict[str, Any]:
    """The document."""
    return {
        'schema': 'scara_kinetostatic/paper/1',
        'actual': PAPER_ACTUAL.as_dict(),
        'paper': {'estimated': ESTIMATED.as_dict(), 'estimated_from_noise': ESTIMATED_FROM_NOISE.as_dict()},
        'one_level': _run(r.exact),
        'three_levels': _run(r.exact_levels),
        'noise_of_table_2': [
            {
                'joint': study.noise.joint_rms,
                'force': study.noise.force_rms,
                'force_error': study.force_error,
                'force_error_std': study.force_error_std,
                'z': _named(study.z),
                'chi_square': study.chi_square,
                'degrees_of_freedom': study.rank,
            }
            for study in r.noises
        ],
        'noisy': {'noise': {'joint': r.noise.joint_rms, 'force': r.noise.force_rms}, **_run(r.noisy)},
        'monte_carlo': {'paper': _scatter(r.monte_carlo.paper), 'weighted': _scatter(r.monte_carlo.weighted)},
        'gripper': [
            {
                'part': part.name,
                'explained_by_base_model': part.explained,
                'std': part.std if np.isfinite(part.std) else None,
                'biases': part.biases,
            }
            for part in r.gripper
        ],
        'dial_gauge': dial_gauge_document(r.dial_gauge),
    }


def _run(run: Run) -> dict[str, Any]:
    paper, weighted = run.paper, run.weighted
    return {
        'paper_algorithm': {
            'parameters': paper.parameters.as_dict(),
            'force_error': paper.force_error,
            'iterations': paper.iterations,
            'history': list(paper.history),
            'rank': paper.rank,
        },
        'weighted': {
            'parameters': weighted.parameters.as_dict(),
            'force_error': weighted.force_error,
            'iterations': weighted.iterations,
            'rank': weighted.identifiability.rank,
            'confounded': [list(group) for group in weighted.identifiability.confounded],
        },
    }


def _scatter(scatter: Scatter) -> dict[str, Any]:
    return {
        'runs': scatter.runs,
        'predicted': _named(scatter.predicted),
        'found': _named(scatter.found),
        'bias': _named(scatter.bias),
        'force_error': scatter.force_error,
        'force_error_range': list(scatter.force_error_range),
    }


def _named(values: Any) -> dict[str, float]:
    return dict(zip(NAMES, np.asarray(values).tolist(), strict=True))
