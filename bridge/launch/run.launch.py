"""`sidehill run`: the controller server. Parameters of a file of Nav2: bridge/nav2/.

    ros2 launch sidehill run.launch.py config:=/path/to/run.yaml
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    config = os.path.join(get_package_share_directory("sidehill"), "config", "bridge")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "config",
                default_value=os.path.join(config, "run_ros2.yaml"),
                description="configuration of `sidehill run`",
            ),
            Node(
                package="sidehill",
                executable="sidehill-drive",
                name="controller_server",
                arguments=["run", LaunchConfiguration("config")],
                output="screen",
                # It stops the vehicle before it ends.
                sigterm_timeout="5",
            ),
        ]
    )
