"""The parameter `cell` of the nodes that cannot do without a cell description."""

from __future__ import annotations

from rclpy.node import Node

from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_NOMINAL
from scara_kinetostatic.nodes import declare

EXAMPLE_CELL = Cell(nominal=PAPER_NOMINAL, discs=PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))
"""The cell of figure 3, the same as `config/cell.yaml`."""


def cell_or_example(node: Node) -> Cell:
    """Declares the parameter and reads the file that it names.

    Raises:
        CellError: the file cannot be read, or makes no sense.
    """
    path = declare.text(node, 'cell', '', 'cell description (YAML file); empty: the example cell of figure 3')
    if path:
        return load_cell(declare.place('cell', path))
    node.get_logger().warning('no cell given, taking the example cell of figure 3; set the parameter cell')
    return EXAMPLE_CELL
