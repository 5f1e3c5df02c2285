"""Decodes a candump log with cantools (PyPI) and compares it with the program's log of its cycles.

    compare_logs.py DATABASE.dbc candump.log cycles.csv

The database is j8.dbc or cia402.dbc.
"""

import csv
import re
import sys

import cantools

# c_l and c_r of config/vehicles/j8.yaml and the scaling of config/bridge.
CORRECTION_LEFT, CORRECTION_RIGHT, RPM_PER_M_S = 1.004, 1.011, 940.0

database = cantools.database.load_file(sys.argv[1])
names = {message.name for message in database.messages}
canopen = "DriveCommand" not in names
frames = []
for line in open(sys.argv[2]):
    time, identifier, data = re.match(r"\((\S+)\) \S+ ([0-9A-F]+)#([0-9A-F]*)", line).groups()
    number, extended = int(identifier, 16), len(identifier) == 8
    # Heartbeats, network management and objects are in no database.
    if canopen and not extended and (number >= 0x580 or number < 0x180):
        continue
    message = database.get_message_by_frame_id(number)
    assert message.is_extended_frame == extended, line
    frames.append((float(time), message.name, message.decode(bytes.fromhex(data), decode_choices=False)))


def told(name):
    return [values for _, n, values in frames if n == name]


if canopen:
    commands = [
        {
            "TractionSpeed": traction["TargetVelocity"],
            "SteerSpeed": steer["TargetVelocity"],
            "words": (traction["Controlword"], steer["Controlword"]),
        }
        for traction, steer in zip(told("TractionRpdo1"), told("SteerRpdo1"))
    ]
    feedback = {"TractionTpdo1": "VelocityActual", "SteerTpdo1": "VelocityActual"}
else:
    commands = told("DriveCommand")
    feedback = {"TractionFeedback": "Speed", "SteerFeedback": "Speed"}

sent = [row for row in csv.DictReader(open(sys.argv[3])) if row["sent"] == "true"]
# Three more frames of zeros end the program after its last cycle.
assert 0 <= len(commands) - len(sent) <= 3, (len(commands), len(sent))
# A comparison of a few frames would show nothing; a drive sends about 20 a second for 10 s.
assert len(sent) > 150, len(sent)
worst, least, most = 0.0, [0.0, 0.0], [0.0, 0.0]
for i, (row, command) in enumerate(zip(sent, commands)):
    traction, steer = float(row["traction_m_s"]), float(row["steer_m_s"])
    left = (traction - steer) / CORRECTION_LEFT
    right = (traction + steer) / CORRECTION_RIGHT
    for j, (name, wanted) in enumerate([("TractionSpeed", 0.5 * (right + left)), ("SteerSpeed", 0.5 * (right - left))]):
        difference = abs(command[name] - RPM_PER_M_S * wanted)
        worst = max(worst, difference)
        assert difference <= 0.0501, (row, command)
        least[j], most[j] = min(least[j], command[name]), max(most[j], command[name])
    if canopen:
        on = row["enable"] == "true"
        assert all(word in ((0x06, 0x07, 0x0F) if on else (0x02, 0x00)) for word in command["words"]), (row, command)
    else:
        assert command["Mode"] == (row["enable"] == "true"), (row, command)
        assert command["AliveCounter"] == i % 16, (row, command)
for values in commands[len(sent) :]:
    assert values["TractionSpeed"] == values["SteerSpeed"] == 0, values
    assert values.get("Mode", 0) == 0 and values.get("words", (2, 2)) == (2, 2), values

# What was fed back is what the program says it received.
speeds = {name: [values[signal] for values in told(name)] for name, signal in feedback.items()}
for row in sent:
    if row["feedback_traction_m_s"] == "NaN":
        continue
    traction, steer = float(row["feedback_traction_m_s"]), float(row["feedback_steer_m_s"])
    left = (traction - steer) / CORRECTION_LEFT
    right = (traction + steer) / CORRECTION_RIGHT
    for (name, heard), value in zip(speeds.items(), (0.5 * (right + left), 0.5 * (right - left))):
        near = min(abs(RPM_PER_M_S * value - speed) for speed in heard)
        assert near < 1e-6, (row, name)
print(
    f"cantools decoded {len(frames)} frames; {len(sent)} commands agree within {worst:.3f} rpm: "
    f"traction {least[0]:.1f} to {most[0]:.1f}, steer {least[1]:.1f} to {most[1]:.1f}"
)
