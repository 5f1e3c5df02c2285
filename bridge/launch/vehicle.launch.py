"""`sidehill vehicle`: the virtual rover.

    ros2 launch sidehill vehicle.launch.py config:=/path/to/vehicle.yaml
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    config = os.path.join(get_package_share_directory("sidehill"), "config", "bridge", "vehicle_ros2.yaml")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "config", default_value=config, description="configuration of `sidehill vehicle`"
            ),
            Node(
                package="sidehill",
                executable="sidehill-drive",
                name="virtual_rover",
                arguments=["vehicle", LaunchConfiguration("config")],
                output="screen",
            ),
        ]
    )
