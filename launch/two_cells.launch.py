"""Two cells side by side, each in a namespace of its own: the pattern for any number of them.

`ros2 launch scara_kinetostatic two_cells.launch.py` simulates both. For real ones `simulate:=false left_cell:=…
right_cell:=…`; topics that the cell descriptions name without a leading slash are in the namespace of their cell.
"""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

NAMES = ('left', 'right')
ONE = PathJoinSubstitution([FindPackageShare('scara_kinetostatic'), 'launch', 'cell.launch.py'])


def generate_launch_description() -> LaunchDescription:
    """Both cells."""
    arguments = [
        DeclareLaunchArgument('simulate', default_value='true', choices=['true', 'false'], description='simulate both'),
        DeclareLaunchArgument('recordings', default_value='recordings', description='each cell has a folder in it'),
        DeclareLaunchArgument('respawn', default_value='true', choices=['true', 'false'], description='of all nodes'),
        *(DeclareLaunchArgument(f'{name}_cell', default_value='', description='cell description') for name in NAMES),
    ]
    return LaunchDescription([*arguments, *(_cell(name, seed) for seed, name in enumerate(NAMES))])


def _cell(name: str, seed: int) -> GroupAction:
    """One cell; its arguments end with the group, so that they are not those of the next."""
    arguments = {
        'namespace': name,
        'cell': LaunchConfiguration(f'{name}_cell'),
        'simulate': LaunchConfiguration('simulate'),
        'respawn': LaunchConfiguration('respawn'),
        'recordings': PathJoinSubstitution([LaunchConfiguration('recordings'), name]),
        'seed': str(seed),
        'enclaves': f'/scara_kinetostatic/{name}',
    }
    return GroupAction([IncludeLaunchDescription(ONE, launch_arguments=arguments.items())], scoped=True)
