"""Reproduce the studies of the paper.

Reproduces the studies of the paper: its algorithm on the cell of figure 3, table
2 without and with noise, identifiability with one force level, the scatter of
both estimators over many data sets, and the dial gauge experiments of section
5.2. Writes into DIR

  paper.html   the paper's figures and tables beside those computed here
  paper.json   all numbers

Example:
  scara-kinetostatic paper --out paper
"""

from __future__ import annotations

import argparse

from scara_kinetostatic.cli.shared_arguments import out_option, progress, whole

ARGUMENTS = (out_option('paper'), ('--runs', 'N', whole(2), 'noisy data sets (default: 1000)', {'default': 1000}))


def run(args: argparse.Namespace) -> None:
    """Reproduces them.

    Raises:
        OutputError: DIR cannot be written.
    """
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.report.page import as_page, json_text
    from scara_kinetostatic.studies.paper.report import paper_document, paper_report
    from scara_kinetostatic.studies.paper.study import reproduce

    with progress() as show_progress:
        found = reproduce(args.runs, show_progress)
        texts = {'paper.html': as_page(paper_report(found)), 'paper.json': json_text(paper_document(found))}
        write_texts(args.out, texts)
    exact, study = found.exact.paper, found.monte_carlo
    print(f'figure 3   e_f {exact.force_error:.1e} N after {exact.iterations} iterations (paper: 4.5e-5 N)')
    print(f'table 2    rank {exact.rank} of 12 with one force level, only 40 p_ee - g_ee is determined')
    print(f'noise      e_f {study["paper"].force_error:.2f} N over {args.runs} data sets (paper: 1.25 to 1.35 N)')
    for name, item in (('unweighted', study['paper']), ('weighted', study['weighted'])):
        ratio = item.found / item.predicted
        print(f'Monte Carlo {name}: {ratio.min():.3f} to {ratio.max():.3f} of the predicted standard deviations')
    print('\n'.join(str(args.out / name) for name in texts))
