"""What the patches of bridge/patches/ mend, with a program that was built with them; SIDEHILL_PATCHED names it."""

import ctypes
import os
import resource
import socket
import struct
import time

import programs
import pytest
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from nodes import SERVER, Node
from std_msgs.msg import Bool

PTRACE_ATTACH, PTRACE_DETACH, WALL = 16, 17, 0x40000000

# Without the patch the first call takes 3 s, the period of Fast DDS's heartbeat.
FIRST_CALL_S = 2.0


@pytest.fixture
def patched(start, tmp_path, monkeypatch):
    """Starts the controller."""
    patched = os.environ.get("SIDEHILL_PATCHED")
    if not patched:
        pytest.skip("SIDEHILL_PATCHED names no program built by bridge/patches/cargo")
    monkeypatch.setattr(programs, "SIDEHILL", patched)
    return lambda: start("run", programs.adapted("run_ros2.yaml", {}, tmp_path))


@pytest.fixture
def controller(patched, ros):
    controller = patched()
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


INFO_TS, DATA = 0x09, 0x15
INVALIDATE = 2


def announced(datagram):
    """Of each publication that a datagram announces: whether it has a source timestamp."""
    at, stamped, found = 20, False, []
    while at + 4 <= len(datagram):
        kind, flags, length = struct.unpack_from("<BBH", datagram, at)
        body = datagram[at + 4 : at + 4 + length] if length or kind == INFO_TS else datagram[at + 4 :]
        if kind == INFO_TS:
            stamped = not flags & INVALIDATE
        elif kind == DATA and body[8:12] == WRITER:
            found.append(stamped)
        at += 4 + len(body)
    return found


def test_endpoints_are_announced_with_a_time_by_which_fast_dds_can_order_them(patched, domain):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("", 7400 + 250 * domain))
        group = socket.inet_aton("239.255.0.1") + socket.inet_aton("127.0.0.1")
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        listener.setblocking(False)
        patched()
        stamped = []

        def some():
            try:
                stamped.extend(announced(listener.recv(65536)))
            except BlockingIOError:
                pass
            return len(stamped) >= 10

        programs.wait_for(some, "endpoints that are announced", timeout_s=60.0)
    assert all(stamped)


# What a program takes that hears such datagrams and does nothing is far below; without the patch it takes all there is.
MEMORY_BYTES = 3 << 30
GROWN_MAX_KB = 400_000
HUGE = (1 << 62) - 1
# Entities of the discovery of publications: that of the peer writes, that of the controller reads, and the reverse.
READER, WRITER = bytes([0, 0, 3, 0xC7]), bytes([0, 0, 3, 0xC2])


def number(value):
    """A sequence number as RTPS has it."""
    return struct.pack("<iI", value >> 32, value & 0xFFFFFFFF)


def submessage(kind, body):
    return struct.pack("<BBH", kind, 1, len(body)) + body


DATAGRAMS = {
    "heartbeat": submessage(0x07, READER + WRITER + number(1) + number(HUGE) + struct.pack("<i", 1 << 30)),
    "gap": submessage(0x08, READER + WRITER + number(1 << 40) + number(HUGE) + struct.pack("<I", 0)),
    "data_frag": submessage(
        0x16,
        struct.pack("<HH", 0, 28) + READER + WRITER + number(1 << 20)
        + struct.pack("<IHHI", 1, 1, 1024, 0xFFFFFF00) + bytes(1024),
    ),
    "nack_frag_0": submessage(0x12, READER + WRITER + number(1) + struct.pack("<IIIi", 0, 1, 1 << 31, 1 << 30)),
    "nack_frag_huge": submessage(0x12, READER + WRITER + number(1) + struct.pack("<IIIi", 1 << 31, 1, 1 << 31, 1 << 30)),
    "overflow": submessage(
        0x07, READER + WRITER + number((1 << 63) - 3) + number((1 << 63) - 1) + struct.pack("<i", 1 << 30)
    ),
}


def memory_kb(pid):
    with open(f"/proc/{pid}/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS"))


def udp_ports(pid):
    """The UDP ports that a process has for itself: peers, which share those of multicast, have such faults, too."""
    own = {os.readlink(file.path)[8:-1] for file in os.scandir(f"/proc/{pid}/fd")}
    with open("/proc/net/udp") as file:
        rows = [line.split() for line in file.readlines()[1:]]
    ports = [(int(row[1].split(":")[1], 16), row[9]) for row in rows]
    taken = [port for port, _ in ports]
    return [port for port, inode in ports if inode in own and taken.count(port) == 1]


@pytest.mark.parametrize("kind", DATAGRAMS)
def test_one_datagram_neither_takes_the_memory_nor_the_hearing(controller, domain, kind):
    pid = controller.process.pid
    resource.prlimit(pid, resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    # The datagram comes from a participant that the controller has discovered.
    peer = Node(domain)
    peer.node.create_publisher(Bool, "/known", 1)
    client = peer.node.create_client(GetState, f"{SERVER}/get_state")
    peer.wait_for(client.service_is_ready, "service", timeout_s=60.0)
    peer.result(client.call_async(GetState.Request()), "call")
    [endpoint] = peer.node.get_publishers_info_by_topic("/known")
    prefix = bytes(endpoint.endpoint_gid[:12])
    datagram = b"RTPS" + bytes([2, 3, 1, 15]) + prefix + DATAGRAMS[kind]
    before_kb = memory_kb(pid)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for port in udp_ports(pid):
            sender.sendto(datagram, ("127.0.0.1", port))
    time.sleep(2.0)
    assert controller.running()
    grown_kb = memory_kb(pid) - before_kb
    print(f"{kind}: {grown_kb} kB more")
    assert grown_kb < GROWN_MAX_KB
    assert first_call_s(domain) < FIRST_CALL_S
    peer.close()
    assert controller.end() == 0
