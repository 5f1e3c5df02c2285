"""Sidehill as the controller server among the nodes of Nav2 (jazzy)."""

import os

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, ExecuteProcess, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = os.path.dirname(os.path.abspath(__file__))


def generate_launch_description():
    params = LaunchConfiguration("params_file")
    controller = ExecuteProcess(
        cmd=[
            LaunchConfiguration("sidehill"),
            "run",
            LaunchConfiguration("config"),
            "--ros-args",
            "-r",
            "__node:=controller_server",
            "--params-file",
            params,
        ],
        name="controller_server",
        output="screen",
    )

    def nav2(package, executable, name, more=None):
        parameters = [params, more] if more else [params]
        return Node(package=package, executable=executable, name=name, output="screen", parameters=parameters)

    return LaunchDescription(
        [
            DeclareLaunchArgument("config", description="configuration of `sidehill run`, autostart: false"),
            DeclareLaunchArgument("map", description="map of the map server"),
            DeclareLaunchArgument("params_file", default_value=os.path.join(HERE, "params.yaml")),
            DeclareLaunchArgument("sidehill", default_value="sidehill", description="the program"),
            controller,
            nav2("nav2_map_server", "map_server", "map_server", {"yaml_filename": LaunchConfiguration("map")}),
            nav2("nav2_planner", "planner_server", "planner_server"),
            nav2("nav2_behaviors", "behavior_server", "behavior_server"),
            nav2(
                "nav2_bt_navigator",
                "bt_navigator",
                "bt_navigator",
                {"default_nav_to_pose_bt_xml": os.path.join(HERE, "navigate.xml")},
            ),
            nav2("nav2_lifecycle_manager", "lifecycle_manager", "lifecycle_manager_navigation"),
            # Without a controller nothing shall go on planning.
            RegisterEventHandler(
                OnProcessExit(
                    target_action=controller,
                    on_exit=[EmitEvent(event=Shutdown(reason="the controller has ended"))],
                )
            ),
        ]
    )
