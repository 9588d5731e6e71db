"""The touch runner on a robot that ros2_control moves: topics and action are those of the controllers.

`ros2 launch scara_kinetostatic ros2_control.launch.py cell:=/path/to/cell.yaml`; the driver of the robot with its
controllers, as `config/ros2_control.yaml` has them, is started by its own launch file. With `use_action:=true` the
controller gets goals, as few as safety needs, instead of messages. `ros2 service call /touch_runner/start
std_srvs/srv/Trigger` begins.
"""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    """The runner, with names of controllers as arguments."""
    controller = LaunchConfiguration('controller')
    kinds = {
        'cell': str,
        'output': str,
        'patience': float,
        'max_touches': int,
        'calibration': str,
        'use_sim_time': bool,
    }
    parameters = {name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, kind in kinds.items()}

    def runner(condition: IfCondition | UnlessCondition, **more: object) -> Node:
        return Node(
            package='scara_kinetostatic',
            executable='touch_runner',
            name='touch_runner',
            namespace=LaunchConfiguration('namespace'),
            output='screen',
            parameters=[{**parameters, **more}],
            remappings=[('joint_trajectory', [controller, '/joint_trajectory'])],
            condition=condition,
        )

    use_action = LaunchConfiguration('use_action')
    action = ParameterValue([controller, '/follow_joint_trajectory'], value_type=str)
    return LaunchDescription(
        [
            DeclareLaunchArgument('cell', description='cell description, with sensor.wrench as the broadcaster has it'),
            DeclareLaunchArgument('controller', default_value='/joint_trajectory_controller', description='its name'),
            DeclareLaunchArgument('use_action', default_value='false', choices=['true', 'false'], description='goals'),
            DeclareLaunchArgument('output', default_value='recordings', description='folder for recording and result'),
            DeclareLaunchArgument('patience', default_value='30.0', description='for what passes by itself, s'),
            DeclareLaunchArgument('max_touches', default_value='100', description='after which the run ends'),
            DeclareLaunchArgument('calibration', default_value='', description='calibration.json to begin with'),
            DeclareLaunchArgument('namespace', default_value='', description='of the runner, such as left'),
            DeclareLaunchArgument(
                'use_sim_time', default_value='false', choices=['true', 'false'], description='/clock'
            ),
            runner(UnlessCondition(use_action)),
            runner(IfCondition(use_action), action=action),
        ]
    )
