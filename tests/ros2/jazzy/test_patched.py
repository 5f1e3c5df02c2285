"""What the patches of bridge/patches/ mend, with a program that was built with them; SIDEHILL_PATCHED names it."""

import ctypes
import os
import time

import programs
import pytest
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from nodes import SERVER, Node

PTRACE_ATTACH, PTRACE_DETACH, WALL = 16, 17, 0x40000000

# Without the patch the first call takes 3 s, the period of Fast DDS's heartbeat.
FIRST_CALL_S = 2.0


@pytest.fixture
def controller(start, ros, tmp_path, monkeypatch):
    patched = os.environ.get("SIDEHILL_PATCHED")
    if not patched:
        pytest.skip("SIDEHILL_PATCHED names no program built by bridge/patches/cargo")
    monkeypatch.setattr(programs, "SIDEHILL", patched)
    controller = start("run", programs.adapted("run_ros2.yaml", {}, tmp_path))
    # Known to the node of the test: from now on clients find a server that has been there for long.
    client = ros.node.create_client(GetState, f"{SERVER}/get_state")
    ros.wait_for(client.service_is_ready, "service", timeout_s=60.0)
    return controller


def first_call_s(domain):
    """How long the first call of a fresh node takes that calls as soon as it sees the service."""
    fresh = Node(domain)
    client = fresh.node.create_client(GetState, f"{SERVER}/get_state")
    fresh.wait_for(client.service_is_ready, "service")
    began = time.monotonic()
    answer = fresh.result(client.call_async(GetState.Request()), "first call")
    took_s = time.monotonic() - began
    fresh.close()
    assert answer.current_state.id == State.PRIMARY_STATE_ACTIVE
    return took_s


def trace_shortly(pid):
    """Attaches to all threads of a process like a debugger, and detaches."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
    libc.ptrace.restype = ctypes.c_long

    def ptrace(request, thread):
        assert libc.ptrace(request, thread, None, None) == 0, os.strerror(ctypes.get_errno())

    threads = [int(thread) for thread in os.listdir(f"/proc/{pid}/task")]
    for thread in threads:
        ptrace(PTRACE_ATTACH, thread)
        os.waitpid(thread, WALL)
    for thread in threads:
        ptrace(PTRACE_DETACH, thread)


def test_the_first_calls_of_fresh_nodes_do_not_wait_for_a_heartbeat(controller, domain):
    took_s = sorted(first_call_s(domain) for _ in range(10))
    print(f"first calls answered after {[round(t, 3) for t in took_s]} s")
    assert took_s[-1] < FIRST_CALL_S


def test_the_middleware_survives_a_debugger(controller, domain):
    trace_shortly(controller.process.pid)
    assert controller.running()
    # A loop that ends would do so at once; a node that calls now has to be discovered first.
    assert first_call_s(domain) < FIRST_CALL_S
