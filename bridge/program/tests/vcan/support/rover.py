"""What the vehicles of other makers share: frames by cantools with a checksum of their own, and a
chassis that moves on level ground by the ICRs of config/vehicles/j8.yaml."""

import math

import can

DATA_IDS = {
    "DriveCommand": [0x01, 0x00],
    "TractionFeedback": [0x01, 0x01],
    "SteerFeedback": [0x02, 0x01],
    "AhrsAttitude": [0x03, 0xFF],
    "PosePosition": [0x04, 0xFF],
    "PoseHeading": [0x05, 0xFF],
}
# x_icr_left_m, x_icr_right_m, y_icr_m, correction_left and correction_right of the vehicle.
LEFT_M, RIGHT_M, FORWARD_M, CORRECTION_LEFT, CORRECTION_RIGHT = -0.980, 1.073, 0.206, 1.004, 1.011


def checksum(name, data):
    """CRC-8/SAE-J1850, bit by bit, over the data id and all bytes but the last."""
    crc = 0xFF
    for byte in DATA_IDS[name] + list(data[:-1]):
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


class Chassis:
    def __init__(self, yaw):
        self.x = self.y = 0.0
        self.yaw = yaw
        self.moved = 0.0

    def roll(self, seconds, traction, steer):
        """Moves on with these speeds of the motors, m/s."""
        left, right = CORRECTION_LEFT * (traction - steer), CORRECTION_RIGHT * (traction + steer)
        rate = (right - left) / (RIGHT_M - LEFT_M)
        forward, aside = (RIGHT_M * left - LEFT_M * right) / (RIGHT_M - LEFT_M), FORWARD_M * rate
        self.x += seconds * (aside * math.cos(self.yaw) - forward * math.sin(self.yaw))
        self.y += seconds * (aside * math.sin(self.yaw) + forward * math.cos(self.yaw))
        self.yaw += seconds * rate
        self.moved += seconds * abs(traction)


class Reports:
    """Sends messages of the database with counter and checksum."""

    def __init__(self, database, bus):
        self.database, self.bus = database, bus
        self.counters = {name: 0 for name in DATA_IDS}

    def send(self, name, **values):
        message = self.database.get_message_by_name(name)
        modulus = 1 << message.get_signal_by_name("AliveCounter").length
        counter = self.counters[name] % modulus
        data = bytearray(message.encode({**values, "AliveCounter": counter, "Checksum": 0}))
        self.counters[name] += 1
        data[-1] = checksum(name, data)
        extended = message.is_extended_frame
        self.bus.send(can.Message(arbitration_id=message.frame_id, is_extended_id=extended, data=data))

    def send_sensors(self, chassis):
        self.send("AhrsAttitude", Roll=0.0, Pitch=0.0)
        self.send("PosePosition", X=chassis.x, Y=chassis.y)
        self.send("PoseHeading", Z=0.0, Yaw=math.remainder(chassis.yaw, 2.0 * math.pi))
