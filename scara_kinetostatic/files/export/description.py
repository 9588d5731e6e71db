"""URDF and xacro of the calibrated arm: rigid, with the joint offsets in the origins of the joints."""

from __future__ import annotations

from xml.sax.saxutils import escape, quoteattr

from scara_kinetostatic.files.export.facts import RIGID, ExportFacts
from scara_kinetostatic.files.urdf import CALIBRATED_COLOUR, Arm, arm_urdf
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.parameters import UNITS

ROBOT = 'scara'
"""Name of the robot where the cell description gives none."""
_HEAD = '<?xml version="1.0"?>\n'


def urdf_text(arm: CalibratedArm, facts: ExportFacts) -> str:
    """The URDF: its tip `tool0` is at H(L̄, Q) for the joint angles Q that the robot reports."""
    text = arm_urdf(_name(arm), arm.cell.joint_names, [Arm(arm.model.parameters, colour=CALIBRATED_COLOUR)])
    return text.replace(_HEAD, _HEAD + _comment(facts), 1)


def xacro_text(arm: CalibratedArm, facts: ExportFacts) -> str:
    """The same as a xacro: properties, a macro that a xacro of one's own may include, and the arm made by it.

    With the argument ``standalone:=false`` the macro is defined and no arm is made.
    """
    p = arm.model.parameters
    properties = '\n'.join(
        f'  <xacro:property name="scara_{name}" value="{getattr(p, name)!r}"/>  <!-- {UNITS[name]}, {std} -->'
        for name, std in zip(UNITS, facts.std, strict=True)
        if name in RIGID
    )
    first, second = (escape('${prefix}' + name, {'"': '&quot;'}) for name in map(_literal, arm.cell.joint_names))
    return (
        f'{_HEAD}{_comment(facts)}<robot name={quoteattr(_name(arm))} xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
        f'  <xacro:arg name="standalone" default="true"/>\n{properties}\n'
        f'{_MACRO.format(joint1=first, joint2=second)}'
        '  <xacro:if value="$(arg standalone)">\n'
        '    <link name="base_link"/>\n'
        '    <xacro:calibrated_scara parent="base_link"/>\n'
        '  </xacro:if>\n'
        '</robot>\n'
    )


_MACRO = """\
  <xacro:macro name="calibrated_scara" params="parent prefix:=''">
    <link name="${{prefix}}link1"/>
    <link name="${{prefix}}link2"/>
    <link name="${{prefix}}tool0"/>
    <joint name="{joint1}" type="continuous">
      <parent link="${{parent}}"/>
      <child link="${{prefix}}link1"/>
      <origin xyz="${{scara_x0}} ${{scara_y0}} 0" rpy="0 0 ${{scara_theta1}}"/>
      <axis xyz="0 0 1"/>
    </joint>
    <joint name="{joint2}" type="continuous">
      <parent link="${{prefix}}link1"/>
      <child link="${{prefix}}link2"/>
      <origin xyz="${{scara_l1}} 0 0" rpy="0 0 ${{scara_theta2}}"/>
      <axis xyz="0 0 1"/>
    </joint>
    <joint name="${{prefix}}tip" type="fixed">
      <parent link="${{prefix}}link2"/>
      <child link="${{prefix}}tool0"/>
      <origin xyz="${{scara_l2}} 0 0" rpy="0 0 0"/>
    </joint>
  </xacro:macro>
"""


def _literal(name: str) -> str:
    """A name in which xacro expands nothing."""
    return name.replace('${', '$${').replace('$(', '$$(')


def _name(arm: CalibratedArm) -> str:
    return arm.cell.identification.robot or ROBOT


def _comment(facts: ExportFacts) -> str:
    lines = '\n'.join(f'  {escape(line)}' for line in facts.lines)
    return f'<!--\n{lines}\n-->\n'
