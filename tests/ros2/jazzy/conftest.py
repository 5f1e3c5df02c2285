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
    def driven(of_controller={}, of_vehicle={}):
        pressers = lambda: ros.node.count_publishers("/emergency_stop")
        others = pressers()
        rover = vehicle(of_vehicle)
        # Of two programs that appear at once Fast DDS may pass over endpoints for good, unless they have the patch
        # (bridge/patches/README.md). This is the vehicle's last.
        ros.wait_for(lambda: pressers() > others, "the vehicle", timeout_s=60.0)
        start("run", adapted("run_ros2.yaml", of_controller, tmp_path))
        return Driven(rover, ros)

    return driven
