"""Sphinx configuration of the documentation site.

    pip install '.[docs]' && sphinx-build -W -n --keep-going docs docs/_build/html

The site needs no network: no web fonts, no script of another host; equations are MathML, made when the site is built.
rosdoc2 uses this file; it needs `pip install '.[docs]'`, too. The reference of commands, nodes, effects and the Python
interface is generated from the code.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / '_ext')]

from scara_kinetostatic import __version__  # noqa: E402  the checkout is on the path only now
from scara_kinetostatic.threads import process_of_one_thread  # noqa: E402

process_of_one_thread()  # the catalogue of effects diagnoses a robot for each

project = 'scara_kinetostatic'
author = 'scara_kinetostatic maintainers'
copyright = author
release = version = __version__

extensions = ['myst_parser', 'mathml', 'architecture', 'command_reference', 'effect_reference', 'node_reference']
extensions += ['python_reference']
source_suffix = {'.md': 'markdown'}
root_doc = 'index'
exclude_patterns = ['_build', '_ext']

myst_enable_extensions = ['dollarmath', 'amsmath', 'deflist', 'colon_fence', 'fieldlist']
myst_heading_anchors = 4
math_number_all = False

autodoc_typehints = 'signature'
autodoc_type_aliases = {name: name for name in ('ArrayLike', 'Floats', 'Indices', 'Paths')}
autodoc_member_order = 'bysource'
python_use_unqualified_type_names = True
add_module_names = False

html_theme = 'furo'
html_math_renderer = 'mathml'
html_title = 'scara_kinetostatic'
html_static_path = ['_static']
html_css_files = ['site.css']
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    'navigation_with_keys': True,
    'light_css_variables': {
        'font-stack': 'system-ui, -apple-system, "Segoe UI", "Noto Sans", "DejaVu Sans", sans-serif'
    },
}
