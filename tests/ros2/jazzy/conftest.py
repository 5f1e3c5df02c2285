import pytest
import rclpy
from nodes import Driven, Node
from programs import adapted


@pytest.fixture
def middleware():
    assert rclpy.get_rmw_implementation_identifier() == "rmw_fastrtps_cpp"
    return "rmw_fastrtps_cpp"


@pytest.fixture
def ros(domain):
    node = Node(domain)
    yield node
    node.close()


@pytest.fixture
def driven(vehicle, start, ros, tmp_path):
    def driven(of_controller={}, of_vehicle={}, *arguments):
        rover = vehicle(of_vehicle)
        controller = start("run", adapted("run_ros2.yaml", of_controller, tmp_path), *arguments)
        return Driven(rover, controller, ros)

    return driven
