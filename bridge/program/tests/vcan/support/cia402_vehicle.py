"""A vehicle with two drives of CiA 402, played by canopen (PyPI): its nodes, object dictionary, SDO
server, network management, PDOs and table of states; AHRS and pose source by cantools.

    cia402_vehicle.py DATABASE.dbc INTERFACE HEADING_DEG TRUTH.csv

Standard input takes one word a line, with the name of a drive:
    fault D          it has a fault
    mute D, talk D   its heartbeat stops, and comes again
    stop D           its quick stop is activated by somebody else
    refuse D OBJECT, accept D   it refuses an object to be written, or none
    freeze D, mirror D   it reports its last speed again and again, or speeds of the other sign
    loose D          it no longer obeys its controlword
The end of standard input ends the program.
"""

import math
import sys
import threading
import time

import can
import canopen
import cantools
from canopen import objectdictionary as od
from canopen.profiles.p402 import State402
from canopen.sdo import SdoAbortedError
from rover import Chassis, Reports

RAW_PER_M_S = 9400.0  # 0.1 rpm, 940 rpm in 1 m/s
ACCELERATION, QUICK_STOP = 2.0, 3.0  # m/s^2
TICK_S, SENSORS_S = 0.005, 0.05


def dictionary(node):
    """The objects of a drive. Its mode, heartbeat and event timer are 0 until they are written."""
    objects = od.ObjectDictionary()

    def variable(index, sub, name, kind, default):
        entry = od.ODVariable(name, index, sub)
        entry.data_type, entry.access_type, entry.default = kind, "rw", default
        return entry

    def record(index, name, *members):
        entry = od.ODRecord(name, index)
        entry.add_member(variable(index, 0, "Entries", od.UNSIGNED8, len(members)))
        for sub, kind, default in members:
            entry.add_member(variable(index, sub, f"{name} {sub}", kind, default))
        objects.add_object(entry)

    for index, name, kind in [
        (0x1000, "Device type", od.UNSIGNED32),
        (0x1001, "Error register", od.UNSIGNED8),
        (0x1017, "Producer heartbeat", od.UNSIGNED16),
        (0x6007, "Abort connection option", od.INTEGER16),
        (0x605A, "Quick stop option", od.INTEGER16),
        (0x6060, "Modes of operation", od.INTEGER8),
        (0x6061, "Modes of operation display", od.INTEGER8),
        (0x6040, "Controlword", od.UNSIGNED16),
        (0x6041, "Statusword", od.UNSIGNED16),
        (0x606C, "Velocity actual", od.INTEGER32),
        (0x60FF, "Target velocity", od.INTEGER32),
    ]:
        default = 0x00020192 if index == 0x1000 else 0  # a servo drive of CiA 402
        objects.add_object(variable(index, 0, name, kind, default))
    record(0x1016, "Consumer heartbeat", (1, od.UNSIGNED32, 0))
    u8, u16, u32 = od.UNSIGNED8, od.UNSIGNED16, od.UNSIGNED32
    record(0x1003, "Errors", (1, u32, 0), (2, u32, 0))
    record(0x1018, "Identity", (1, u32, 0x2A), (2, u32, 0x402), (3, u32, 0x10000), (4, u32, 1000 + node))
    record(0x1400, "RPDO", (1, u32, 0x200 + node), (2, u8, 255), (5, u16, 0))
    record(0x1600, "RPDO map", (1, u32, 0x60400010), (2, u32, 0x60FF0020))
    record(0x1800, "TPDO", (1, u32, 0x180 + node), (2, u8, 255), (3, u16, 0), (5, u16, 0))
    record(0x1A00, "TPDO map", (1, u32, 0x60410010), (2, u32, 0x606C0020))
    return objects


class Drive:
    def __init__(self, network, number):
        self.network = network
        self.node = canopen.LocalNode(number, dictionary(number))
        network.add_node(self.node)
        self.node.rpdo.read(from_od=True)
        self.node.tpdo.read(from_od=True)
        self.node.rpdo[1].add_callback(self.command)
        self.node.add_write_callback(self.written)
        self.refused, self.loose = None, False
        self.reported = lambda speed: speed
        self.lock = threading.RLock()
        self.heard = {}
        for consumer in range(1, 128):
            network.subscribe(0x700 + consumer, self.hear)
        self.boot()

    def boot(self):
        with self.lock:
            self.node.data_store.clear()
            self.node.nmt.stop_heartbeat()
            self.state, self.control, self.target, self.speed = "SWITCH ON DISABLED", 0, 0, 0.0
            self.due = 0.0
            self.commanded = None  # the deadline begins with the first command
            self.heard.clear()
        self.node.nmt.send_command(0x81)  # the boot-up message
        self.node.nmt.send_command(0x80)

    def hear(self, identifier, data, timestamp):
        self.heard[identifier - 0x700] = time.monotonic()

    def written(self, index, subindex, od, data):
        if index == self.refused:
            raise SdoAbortedError(0x06090030)
        if index == 0x6060:
            self.node.sdo[0x6061].raw = int.from_bytes(data, "little", signed=True)

    def read(self, index, sub=0):
        value = self.node.sdo[index]
        return value[sub].raw if sub else value.raw

    def command(self, pdo):
        with self.lock:
            if self.node.nmt.state != "OPERATIONAL":
                return
            self.commanded = time.monotonic()
            if self.loose:
                return
            before, self.control = self.control, pdo["Controlword"].raw
            self.target = pdo["Target velocity"].raw
            if self.state == "FAULT":
                if self.control & ~before & State402.CW_SWITCH_ON_DISABLED:
                    self.state = "SWITCH ON DISABLED"
                return
            if self.control == State402.CW_QUICK_STOP and self.state in ("READY TO SWITCH ON", "SWITCHED ON"):
                self.state = "SWITCH ON DISABLED"
                return
            for (before, after), word in State402.TRANSITIONTABLE.items():
                # Transition 16, back from a quick stop, is optional; this drive does not have it.
                if (before, after) == ("QUICK STOP ACTIVE", "OPERATION ENABLED"):
                    continue
                if before == self.state and word == self.control and "NOT READY" not in before + after:
                    self.state = after
                    return

    def step(self, now):
        """Moves on by a tick."""
        if self.node.nmt.state == "INITIALISING":  # reset by some network management
            self.boot()
        with self.lock:
            consumer = self.read(0x1016, 1)
            number, limit = consumer >> 16, (consumer & 0xFFFF) / 1000.0
            silent = number and now - self.heard.get(number, now) > limit
            if self.node.nmt.state != "OPERATIONAL":
                self.commanded = None
            deadline = self.read(0x1400, 5) / 1000.0
            silent = silent or bool(deadline and self.commanded and now - self.commanded > deadline)
            # CiA 402 does not name pre-operational: there a drive keeps its target.
            gone = silent or self.node.nmt.state == "STOPPED"
            if self.state == "OPERATION ENABLED" and gone and self.read(0x6007) == 3:
                self.state = "QUICK STOP ACTIVE"
            follows = self.state == "OPERATION ENABLED" and self.read(0x6060) == 3
            target = self.target / RAW_PER_M_S if follows else 0.0
            step = TICK_S * (ACCELERATION if follows else QUICK_STOP)
            self.speed += min(max(target - self.speed, -step), step)
            if self.state == "QUICK STOP ACTIVE" and self.speed == 0.0 and self.read(0x605A) == 2:
                self.state = "SWITCH ON DISABLED"
            period = self.read(0x1800, 5) / 1000.0
            if self.node.nmt.state == "OPERATIONAL" and period and now >= self.due:
                self.due = max(self.due + period, now)
                pdo = self.node.tpdo[1]
                # Remote control, and a bit of the maker's own.
                pdo["Statusword"].raw = State402.SW_MASK[self.state][1] | 0x4200
                pdo["Velocity actual"].raw = round(RAW_PER_M_S * self.reported(self.speed))
                pdo.transmit()
            self.node.sdo[0x6041].raw = State402.SW_MASK[self.state][1] | 0x4200

    def tell(self, words):
        with self.lock:
            if words[0] == "fault":
                self.state = "FAULT"
                self.node.sdo[0x1001].raw = 0x05
                self.node.sdo[0x1003][0].raw = 1
                self.node.sdo[0x1003][1].raw = 0x00073210
                self.node.emcy.send(0x3210, 0x05)
            elif words[0] == "stop":
                self.state = "QUICK STOP ACTIVE"
            elif words[0] == "mute":
                self.node.nmt.stop_heartbeat()
            elif words[0] == "talk":
                self.node.nmt.start_heartbeat(self.read(0x1017))
            elif words[0] == "freeze":
                last = self.speed
                self.reported = lambda speed: last
            elif words[0] == "mirror":
                self.reported = lambda speed: -speed
            elif words[0] == "loose":
                self.loose = True
            elif words[0] == "refuse":
                self.refused = int(words[2], 16)
            elif words[0] == "accept":
                self.refused = None


def main():
    database = cantools.database.load_file(sys.argv[1])
    network = canopen.Network()
    network.connect(interface="socketcan", channel=sys.argv[2])
    drives = {"traction": Drive(network, 1), "steer": Drive(network, 2)}
    reports = Reports(database, can.Bus(interface="socketcan", channel=sys.argv[2]))
    chassis = Chassis(math.radians(float(sys.argv[3])))
    ended = threading.Event()

    def listen():
        for line in sys.stdin:
            words = line.split()
            drives[words[1]].tell(words)
        ended.set()

    threading.Thread(target=listen, daemon=True).start()
    truth = open(sys.argv[4], "w", buffering=1)
    truth.write("unix_s,x_m,y_m,yaw_rad,traction_m_s,steer_m_s,mode\n")
    due = sensors_due = time.monotonic()
    while not ended.is_set():
        due += TICK_S
        time.sleep(max(0.0, due - time.monotonic()))
        now = time.monotonic()
        for drive in drives.values():
            drive.step(now)
        traction, steer = drives["traction"].speed, drives["steer"].speed
        chassis.roll(TICK_S, traction, steer)
        if now >= sensors_due:
            sensors_due += SENSORS_S
            reports.send_sensors(chassis)
            on = any(drive.state in ("OPERATION ENABLED", "QUICK STOP ACTIVE") for drive in drives.values())
            mode = "Enabled" if on else "Disabled"
            truth.write(f"{time.time():.6f},{chassis.x},{chassis.y},{chassis.yaw},{traction},{steer},{mode}\n")
    network.disconnect()


main()
