"""A vehicle of other makers: python-can and cantools (both PyPI), with a checksum of its own.

    foreign_vehicle.py DATABASE.dbc INTERFACE SECONDS

It says "ready" when its seconds begin.
It answers the handshake, reaches every speed at once, moves on level ground, and checks every
command's checksum and counter. The exit status is 0 where all were right and it was
driven.
"""

import json
import math
import sys
import time

import can
import cantools
from rover import Chassis, Reports, checksum

database = cantools.database.load_file(sys.argv[1])
bus = can.Bus(interface="socketcan", channel=sys.argv[2])
seconds = float(sys.argv[3])
RPM_PER_M_S = 940.0

reports, chassis = Reports(database, bus), Chassis(math.atan2(-2 * 2.4, 3.9))
traction = steer = 0.0
mode, ready, last_counter, bad, commands = 1, False, None, 0, 0
print("ready", flush=True)
start = due = time.monotonic()
while time.monotonic() < start + seconds:
    received = bus.recv(timeout=max(0.0, due - time.monotonic()))
    if received is not None and not received.is_extended_id and received.arbitration_id == 0x100:
        command = database.decode_message(0x100, received.data, decode_choices=False)
        commands += 1
        bad += received.data[7] != checksum("DriveCommand", received.data)
        bad += last_counter is not None and command["AliveCounter"] != (last_counter + 1) % 16
        last_counter = command["AliveCounter"]
        wanted = (command["TractionSpeed"] / RPM_PER_M_S, command["SteerSpeed"] / RPM_PER_M_S)
        if not command["Mode"]:
            mode, ready = 1, wanted == (0.0, 0.0)
        elif ready and wanted == (0.0, 0.0):
            mode = 2
        traction, steer = wanted if mode == 2 else (0.0, 0.0)
    if time.monotonic() >= due:
        due += 0.05
        chassis.roll(0.05, traction, steer)
        reports.send("TractionFeedback", Speed=RPM_PER_M_S * traction, State=mode)
        reports.send("SteerFeedback", Speed=RPM_PER_M_S * steer, State=mode)
        reports.send_sensors(chassis)
print(json.dumps({"commands": commands, "bad": bad, "moved_m": round(chassis.moved, 3)}))
sys.exit(0 if bad == 0 and commands > 50 and chassis.moved > 1.0 else 1)
