"""A vehicle of other makers: python-can and cantools (both PyPI), with a checksum of its own.

    foreign_vehicle.py DATABASE.dbc INTERFACE SECONDS

It answers the handshake, reaches every speed at once, rolls without slip on level ground, and
checks every command's checksum and counter. The exit status is 0 where all were right and it was
driven.
"""

import json
import math
import sys
import time

import can
import cantools

database = cantools.database.load_file(sys.argv[1])
bus = can.Bus(interface="socketcan", channel=sys.argv[2])
seconds = float(sys.argv[3])
RPM_PER_M_S, TRACK_M = 940.0, 2.1
DATA_IDS = {
    "DriveCommand": [0x01, 0x00],
    "TractionFeedback": [0x01, 0x01],
    "SteerFeedback": [0x02, 0x01],
    "AhrsAttitude": [0x03, 0xFF],
    "PosePosition": [0x04, 0xFF],
    "PoseHeading": [0x05, 0xFF],
}
counters = {name: 0 for name in DATA_IDS}


def checksum(name, data):
    """CRC-8/SAE-J1850, bit by bit, over the data id and all bytes but the last."""
    crc = 0xFF
    for byte in DATA_IDS[name] + list(data[:-1]):
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def send(name, **values):
    message = database.get_message_by_name(name)
    modulus = 1 << message.get_signal_by_name("AliveCounter").length
    data = bytearray(message.encode({**values, "AliveCounter": counters[name] % modulus, "Checksum": 0}))
    counters[name] += 1
    data[-1] = checksum(name, data)
    bus.send(can.Message(arbitration_id=message.frame_id, is_extended_id=message.is_extended_frame, data=data))


x = y = 0.0
yaw = math.atan2(-2 * 2.4, 3.9)
traction = steer = 0.0
mode, ready, last_counter, bad, commands, moved = 1, False, None, 0, 0, 0.0
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
        x -= 0.05 * traction * math.sin(yaw)
        y += 0.05 * traction * math.cos(yaw)
        yaw += 0.05 * 2.0 * steer / TRACK_M
        moved += 0.05 * abs(traction)
        send("TractionFeedback", Speed=RPM_PER_M_S * traction, State=mode)
        send("SteerFeedback", Speed=RPM_PER_M_S * steer, State=mode)
        send("AhrsAttitude", Roll=0.0, Pitch=0.0)
        send("PosePosition", X=x, Y=y)
        send("PoseHeading", Z=0.0, Yaw=math.remainder(yaw, 2.0 * math.pi))
print(json.dumps({"commands": commands, "bad": bad, "moved_m": round(moved, 3)}))
sys.exit(0 if bad == 0 and commands > 50 and moved > 1.0 else 1)
