"""Decodes a candump log with cantools (PyPI) and compares it with the program's log of its cycles.

    compare_logs.py DATABASE.dbc candump.log cycles.csv
"""

import csv
import re
import sys

import cantools

# c_l and c_r of config/vehicles/j8.yaml and the scaling of config/bridge/can.yaml.
CORRECTION_LEFT, CORRECTION_RIGHT, RPM_PER_M_S = 1.004, 1.011, 940.0

database = cantools.database.load_file(sys.argv[1])
frames = []
for line in open(sys.argv[2]):
    time, identifier, data = re.match(r"\((\S+)\) \S+ ([0-9A-F]+)#([0-9A-F]*)", line).groups()
    message = database.get_message_by_frame_id(int(identifier, 16))
    assert message.is_extended_frame == (len(identifier) == 8), line
    frames.append((float(time), message.name, message.decode(bytes.fromhex(data), decode_choices=False)))

sent = [row for row in csv.DictReader(open(sys.argv[3])) if row["sent"] == "true"]
commands = [values for _, name, values in frames if name == "DriveCommand"]
# Three more frames of zeros end the program after its last cycle.
assert 0 <= len(commands) - len(sent) <= 3, (len(commands), len(sent))
assert len(sent) > 1000, len(sent)
worst = 0.0
for i, (row, command) in enumerate(zip(sent, commands)):
    traction, steer = float(row["traction_m_s"]), float(row["steer_m_s"])
    left = (traction - steer) / CORRECTION_LEFT
    right = (traction + steer) / CORRECTION_RIGHT
    difference = max(
        abs(command["TractionSpeed"] - RPM_PER_M_S * 0.5 * (right + left)),
        abs(command["SteerSpeed"] - RPM_PER_M_S * 0.5 * (right - left)),
    )
    worst = max(worst, difference)
    assert difference <= 0.0501, (row, command)
    assert command["Mode"] == (row["enable"] == "true"), (row, command)
    assert command["AliveCounter"] == i % 16, (row, command)
for values in commands[len(sent):]:
    assert values["TractionSpeed"] == values["SteerSpeed"] == values["Mode"] == 0, values

# What was fed back is what the program says it received.
speeds = {name: [v["Speed"] for _, n, v in frames if n == name] for name in ("TractionFeedback", "SteerFeedback")}
for row in sent:
    if row["feedback_traction_m_s"] == "NaN":
        continue
    traction, steer = float(row["feedback_traction_m_s"]), float(row["feedback_steer_m_s"])
    left = (traction - steer) / CORRECTION_LEFT
    right = (traction + steer) / CORRECTION_RIGHT
    for name, value in (("TractionFeedback", 0.5 * (right + left)), ("SteerFeedback", 0.5 * (right - left))):
        near = min(abs(RPM_PER_M_S * value - speed) for speed in speeds[name])
        assert near < 1e-6, (row, name)
print(f"cantools decoded {len(frames)} frames; {len(sent)} commands agree within {worst:.3f} rpm")
