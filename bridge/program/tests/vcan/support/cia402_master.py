"""A master of other make, canopen (PyPI), that leads a drive of CiA 402 through its states and asks it
for its objects. Prints a line of JSON with what it found.

    cia402_master.py DATABASE.dbc INTERFACE NODE
"""

import json
import sys
import time

import can
import canopen
import cantools
from canopen import objectdictionary as od
from canopen.profiles.p402 import State402
from canopen.sdo import SdoAbortedError

RAW_PER_M_S = 9400.0  # 0.1 rpm, 940 rpm in 1 m/s

database = cantools.database.load_file(sys.argv[1])
number = int(sys.argv[3])
name = {1: "Traction", 2: "Steer"}[number]
command, feedback = (database.get_message_by_name(f"{name}{pdo}") for pdo in ("Rpdo1", "Tpdo1"))
network = canopen.Network()
network.connect(interface="socketcan", channel=sys.argv[2])
node = network.add_node(canopen.RemoteNode(number, od.ObjectDictionary()))
found = {}
newest = {}


def hear(identifier, data, timestamp):
    newest.update(feedback.decode(bytes(data)), at=time.monotonic())


def state():
    word = int(newest["Statusword"])
    return next(state for state, (mask, value) in State402.SW_MASK.items() if word & mask == value)


def wait_for(condition, what, for_s=5.0):
    until = time.monotonic() + for_s
    while not condition():
        assert time.monotonic() < until, f"{what}: {heard} {newest}"
        time.sleep(0.005)


def tell(word, speed_m_s=0.0):
    rpm = speed_m_s * RAW_PER_M_S / 10.0
    data = command.encode({"Controlword": word, "TargetVelocity": rpm})
    network.send_message(command.frame_id, data)


def write(index, sub, value, length, signed=False):
    node.sdo.download(index, sub, value.to_bytes(length, "little", signed=signed))


def drive(word, speed_m_s, for_s):
    """Tells it again and again, with the heartbeat of this master."""
    until = time.monotonic() + for_s
    while time.monotonic() < until:
        network.send_message(0x77F, [5])
        tell(word, speed_m_s)
        time.sleep(0.05)


# A reset by the network management is answered by a boot-up message, state 0. It may arrive before
# the call that sends the reset returns, so this listens first; wait_for_bootup() would miss it.
heard = []  # states that heartbeats told
node.nmt.add_heartbeat_callback(heard.append)
node.nmt.send_command(0x81)
wait_for(lambda: 0 in heard, "a boot-up message")
found["device"] = int.from_bytes(node.sdo.upload(0x1000, 0), "little")
try:
    node.sdo.upload(0x5FFF, 0)
except SdoAbortedError as error:
    found["abort"] = error.code
write(0x6060, 0, 3, 1)
write(0x605A, 0, 2, 2)
write(0x6007, 0, 3, 2)
write(0x1016, 1, 0x7F00C8, 4)
write(0x1017, 0, 50, 2)
write(0x1800, 5, 20, 2)
found["mode"] = node.sdo.upload(0x6061, 0)[0]
network.subscribe(feedback.frame_id, hear)
node.nmt.state = "OPERATIONAL"
wait_for(lambda: 5 in heard, "a heartbeat that says operational")
found["nmt"] = node.nmt.state
wait_for(lambda: newest, "a PDO")
found["states"] = [state()]
for word, wanted in [(0x06, "READY TO SWITCH ON"), (0x07, "SWITCHED ON"), (0x0F, "OPERATION ENABLED")]:
    drive(word, 0.0, 0.2)
    wait_for(lambda: state() == wanted, wanted)
    found["states"].append(state())
drive(0x0F, 0.3, 1.0)
found["speed_m_s"] = newest["VelocityActual"] * 10.0 / RAW_PER_M_S
# Silence: it stops quickly, says so, and is off.
silent = time.monotonic()
wait_for(lambda: state() == "QUICK STOP ACTIVE", "a quick stop", 1.0)
found["noticed_s"] = time.monotonic() - silent
wait_for(lambda: state() == "SWITCH ON DISABLED", "off", 2.0)
found["stood_m_s"] = newest["VelocityActual"] * 10.0 / RAW_PER_M_S
found["emergency"] = node.emcy.log[-1].code
print(json.dumps(found))
network.disconnect()
