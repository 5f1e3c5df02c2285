"""The live view over ROS 2: parameters of the node, set by a client of the Foxglove WebSocket protocol that is not ours."""

import contextlib
import json
import os

import wire
from peer import FollowPath
from programs import REPOSITORY, wait_for
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

SPEED = "FollowPath.desired_linear_vel"


class Viewer:
    """A client of the protocol."""

    def __init__(self, stack, port, **options):
        url = f"ws://127.0.0.1:{port}"

        def attempt():
            try:
                return stack.enter_context(connect(url, subprotocols=["foxglove.sdk.v1"], **options))
            except (OSError, WebSocketException):
                return None

        self.socket = wait_for(attempt, "the live view")

    def ask(self, **request):
        self.socket.send(json.dumps(request))

    def next(self, op):
        """The next message of that kind."""
        while True:
            message = self.socket.recv(timeout=10)
            if isinstance(message, str) and json.loads(message)["op"] == op:
                return json.loads(message)

    def set(self, name, value):
        self.ask(op="setParameters", parameters=[{"name": name, "value": value}], id="set")

    def get(self, name):
        self.ask(op="getParameters", parameterNames=[name], id="get")
        while True:
            answer = self.next("parameterValues")
            if answer.get("id") == "get":
                [parameter] = answer["parameters"]
                return parameter["value"]


def test_a_viewer_sets_what_a_ros_client_may_and_nothing_else(start, peer):
    config = os.path.join(REPOSITORY, "config", "bridge", "run_ros2.yaml")
    port = 20000 + os.getpid() % 20000
    start("run", config, "--live", f"127.0.0.1:{port}")
    FollowPath(peer).wait()
    with contextlib.ExitStack() as stack:
        set_from_the_viewer(stack, port, peer)


def set_from_the_viewer(stack, port, peer):
    one, other = Viewer(stack, port), Viewer(stack, port)
    assert "parametersSubscribe" in one.next("serverInfo")["capabilities"]
    other.ask(op="subscribeParameterUpdates", parameterNames=[SPEED])
    before = other.get(SPEED)
    one.set(SPEED, 0.25)
    assert one.next("parameterValues")["parameters"][0]["value"] == 0.25
    [update] = other.next("parameterValues")["parameters"]
    assert (update["name"], update["value"]) == (SPEED, 0.25) and before != 0.25

    # A ROS client sees it, and viewers see what it sets.
    get = peer.client("/controller_server/get_parameters", wire.GetParameters)
    assert get.call(names=[SPEED]).values[0].double_value == 0.25

    for name, value, reason in [
        (SPEED, 1000.0, "out of range"),
        (SPEED, "fast", "must be a double"),
        ("use_sim_time", True, "read-only"),
        ("weights.cross_per_m2", 5.0, "fixed"),
        ("arm", True, "no parameter arm"),
    ]:
        one.set(name, value)
        assert reason in one.next("status")["message"], name
    assert one.get(SPEED) == 0.25

    page = Viewer(stack, port, origin="https://example.org")
    page.set(SPEED, 0.5)
    assert "own machine" in page.next("status")["message"]
    assert page.get(SPEED) == 0.25
