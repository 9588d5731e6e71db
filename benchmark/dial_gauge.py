"""The standard deviations of the dial gauge experiments against simulated errors; false alarms.

    python -m benchmark.dial_gauge [--number 1000] [--json FILE]

Every file is all of section 5.2, simulated: the gripper in 12 directions, both joints, 2 µm gauge noise, values of
figure 4(d). The error of each compliance and gap is divided by its own standard deviation.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmark.common import parser, print_and_save
from scara_kinetostatic.studies.loops.dial_gauge import GRIPPER, JOINT1, JOINT2, analyse_runs
from scara_kinetostatic.studies.paper.study import DialGaugeBench, simulate_experiments


def evaluate(number: int) -> dict[str, object]:
    """Pooled figures of so many files."""
    bench = DialGaugeBench()
    z, warned, isotropy = [], 0, []
    for seed in range(number):
        parts, warnings = analyse_runs(simulate_experiments(bench, seed=seed))
        gripper = parts[GRIPPER]
        wanted = [(run, bench.p_ee, float(bench.gripper_gap(run.readings.direction))) for run in gripper.runs]
        wanted += [(parts[part], bench.p[k], bench.gap[k]) for k, part in enumerate((JOINT1, JOINT2))]
        z.append(
            [
                ((each.compliance.value - p) / each.compliance.std, (each.gap.value - gap) / each.gap.std)
                for each, p, gap in wanted
            ]
        )
        warned += bool(warnings)
        isotropy.append([each.p_value for each in gripper.combined.values()])
    errors, p = np.array(z), np.array(isotropy)
    rms = np.sqrt((errors**2).mean(axis=0))
    return {
        'files': number,
        'rms': float(np.sqrt((errors**2).mean())),
        'rms_smallest': float(rms.min()),
        'rms_largest': float(rms.max()),
        'largest': float(np.abs(errors).max()),
        'files_with_a_false_warning': warned / number,
        'compliance_called_anisotropic_at_1_percent': float((p[:, 0] < 0.01).mean()),
        'gap_called_anisotropic_at_1_percent': float((p[:, 1] < 0.01).mean()),
    }


def main() -> int:
    """Runs the benchmark."""
    options_of = parser(__doc__)
    options_of.add_argument('--number', type=int, default=1000)
    args = options_of.parse_args()
    figures = evaluate(args.number)
    print_and_save(args.json, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
