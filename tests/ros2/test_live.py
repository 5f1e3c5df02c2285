"""The live view over ROS 2: parameters of the node, set by a client of the Foxglove WebSocket protocol that is not ours,
and metrics, read by the parser of the Prometheus project."""

import contextlib
import json
import os
import urllib.request

import wire
from peer import FollowPath, path_of
from programs import REPOSITORY, straight, wait_for
from prometheus_client.openmetrics.parser import text_string_to_metric_families
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


def named(key):
    """The name of a metric of a value in /diagnostics."""
    units = {
        "_m_s2": "_meters_per_second_squared",
        "_rad_s": "_radians_per_second",
        "_m_s": "_meters_per_second",
        "_rad": "_radians",
        "_us": "_seconds",
        "_s": "_seconds",
        "_m": "_meters",
    }
    end = next((end for end in units if key.endswith(end)), "")
    return f"sidehill_{key.removesuffix(end)}{units.get(end, '')}"


def test_metrics_are_openmetrics_with_the_names_of_the_diagnostics(start, vehicle, peer):
    vehicle()
    port = 20000 + os.getpid() % 20000
    start("run", os.path.join(REPOSITORY, "config", "bridge", "run_ros2.yaml"), "--live", f"127.0.0.1:{port}")
    goal = FollowPath(peer).wait().send(path_of(straight(20.0)))
    assert goal.reply.accepted
    diagnostics = peer.reader("/diagnostics", wire.DiagnosticArray)

    def metrics():
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
            assert answer.headers["Content-Type"] == "application/openmetrics-text; version=1.0.0; charset=utf-8"
            return {family.name: family for family in text_string_to_metric_families(answer.read().decode())}

    def driving():
        now = metrics()
        states = now["sidehill_safety"].samples if "sidehill_safety" in now else []
        drives = any(state.labels["state"] == "driving" and state.value == 1.0 for state in states)
        return now if drives and "sidehill_heading_error_radians" in now else None

    now = wait_for(driving, "metrics of a drive")
    names = {named(value.key) for value in diagnostics.next("diagnostics").status[0].values}
    gauges = {name for name, family in now.items() if family.type == "gauge"}
    assert gauges - {"sidehill_slack_seconds"} <= names
    assert len(gauges) > 15, gauges
    counters = {name for name, family in now.items() if family.type == "counter"}
    assert counters - {"sidehill_stops"} <= names
    assert {name for name, family in now.items() if family.type == "histogram"} == {
        "sidehill_lateness_seconds",
        "sidehill_solve_seconds",
    }

    def stops():
        samples = metrics()["sidehill_stops"].samples
        return {sample.labels["cause"]: sample.value for sample in samples if sample.value}

    assert stops() == {}
    goal.cancel()
    assert wait_for(stops, "the stop") == {"cancelled": 1.0}
