"""The first day with random vehicles in MuJoCo: nothing is as the controllers were told.

    python bridge/python/benches/mujoco_first_day.py [--runs 120] [--seed 1]

Vehicles of vehicles.py with another mass, centre of mass and friction, identified from two drives, on slopes in any
direction. Courses and speeds are those of config/campaigns/first_day.yaml. Motors are weaker, slower and later than told,
poses rare, late, noisy and missing, headings off. The table has the cross-track RMS after the first 2 s, of turns on the
spot how far from its place the vehicle ends.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import random
import tempfile
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import sidehill
from mujoco_vehicles import Vehicle
from vehicles import COUNTS_FROM_S, PERIOD_S, REALISTIC, VEHICLES, Measures, identified

KINDS: tuple[sidehill.Kind, ...] = ("contact-mpc", "icrik-mpc", "pure-pursuit")
NAMES = ("J8", "J8, centre of mass 0.7 m high", "J8, equal axle loads", "six wheels, 300 kg", "four wheels, 60 kg")
# Step of the motors, s, and time after which a drive ends, s.
STEP_S = 0.01
LONGEST_S = 400.0
TOLD = REALISTIC | {
    "limits": {
        "traction": {"speed_m_s": 1.5, "acceleration_m_s2": 1.0, "deceleration_m_s2": 2.0},
        "steer": {"speed_m_s": 1.2, "acceleration_m_s2": 2.0, "deceleration_m_s2": 2.0},
        "tread_speed_m_s": 2.5,
    }
}


@dataclass(frozen=True)
class Motor:
    """A motor as it is: lag, s, largest speed and acceleration, gain, and when it is weak, s."""

    lag_s: float
    speed_m_s: float
    acceleration_m_s2: float
    gain: float
    weak: bool

    def step(self, speed_m_s: float, command_m_s: float, time_s: float) -> float:
        """Returns its speed a step later."""
        most_m_s = min(self.speed_m_s, 0.2) if self.weak and 8 <= time_s < 20 else self.speed_m_s
        goal = max(-most_m_s, min(most_m_s, self.gain * command_m_s))
        change = (1 - math.exp(-STEP_S / self.lag_s)) * (goal - speed_m_s)
        rate = self.acceleration_m_s2 if abs(goal) > abs(speed_m_s) else 2.0
        return speed_m_s + max(-rate * STEP_S, min(rate * STEP_S, change))


@dataclass(frozen=True)
class Day:
    """What is drawn for a run."""

    measures: Measures
    course: dict[str, Any]
    slope_deg: float
    uphill_heading_deg: float
    start: dict[str, float]
    delay_s: float
    motors: tuple[Motor, Motor]
    pose_rate_hz: float
    pose_delay_s: float
    gap_s: float
    noise_m: float
    noise_rad: float
    bias_rad: float
    seed: int


def drawn(number: int, seed: int) -> Day:
    draw = random.Random(100_003 * seed + number)

    def log_uniform(low: float, high: float) -> float:
        return math.exp(draw.uniform(math.log(low), math.log(high)))

    measures = VEHICLES[draw.choice(NAMES)]
    size = measures.course
    right_m, forward_m, height_m = measures.centre_of_mass_m
    measures = replace(
        measures,
        friction=draw.uniform(0.6, 0.9),
        mass_kg=measures.mass_kg * draw.uniform(0.9, 1.15),
        centre_of_mass_m=(
            right_m + size * draw.uniform(-0.03, 0.03),
            forward_m + size * draw.uniform(-0.06, 0.06),
            height_m * draw.uniform(0.9, 1.2),
        ),
    )
    speed = {"speed_m_s": math.sqrt(size) * log_uniform(0.05, 1.5)}
    courses: list[dict[str, Any]] = [
        {"shape": "slalom", "length_m": 14 * size, "amplitude_m": 0.8 * size, "wavelength_m": 7 * size} | speed,
        {"shape": "straight", "length_m": 12 * size} | speed,
        {"shape": "cusp", "radius_m": 3 * size, "angle_deg": 80, "turn": draw.choice(["left", "right"])} | speed,
        {"shape": "circle", "radius_m": 2.5 * size, "turns": 1} | speed,
        {"shape": "figure_eight", "half_width_m": 2.4 * size, "half_length_m": 3.9 * size}
        | {"period_s": math.sqrt(size) * log_uniform(25, 150)},
        {"shape": "pivot", "angle_deg": draw.uniform(45, 360), "yaw_rate_rad_s": log_uniform(0.08, 0.6)},
    ]
    weak = draw.choice([None, None, 0, 1])
    motors = [
        Motor(log_uniform(0.05, 0.4), log_uniform(0.25, 1.2), log_uniform(*rates), draw.uniform(0.9, 1.05), weak == place)
        for place, rates in enumerate([(0.3, 1.0), (0.5, 2.0)])
    ]
    return Day(
        measures=measures,
        course=draw.choice(courses),
        slope_deg=draw.uniform(0, 12),
        uphill_heading_deg=draw.uniform(-180, 180),
        start={
            "right_m": size * draw.uniform(-0.3, 0.3),
            "forward_m": size * draw.uniform(-0.2, 0.2),
            "heading_deg": draw.uniform(-20, 20),
        },
        delay_s=draw.uniform(0, 0.4),
        motors=(motors[0], motors[1]),
        pose_rate_hz=draw.choice([1, 2, 5, 10]),
        pose_delay_s=log_uniform(0.05, 0.5),
        gap_s=draw.choice([0, 0, 2, 5]),
        noise_m=log_uniform(0.005, 0.03),
        noise_rad=math.radians(draw.uniform(0.2, 1.0)),
        bias_rad=math.radians(draw.uniform(-1.0, 1.0)),
        seed=draw.randrange(2**30),
    )


def driven(day: Day, file: Path, kind: sidehill.Kind) -> tuple[bool, float]:
    """Returns whether a drive was completed, and its error, m."""
    scenario = sidehill.Scenario.from_dict({
        "name": "day", "vehicle": str(file), "course": day.course, "speed": {"speed_m_s": 3.0}, "start": day.start,
        "terrain": {"kind": "plane", "slope_deg": day.slope_deg, "uphill_heading_deg": day.uphill_heading_deg},
        "controllers": [kind], "plant": "icrik", "seed": 1, "step_s": STEP_S, "controller": TOLD,
    })  # fmt: skip
    vehicle, controller = Vehicle(day.measures, day.slope_deg), sidehill.Controller(scenario, kind=kind)
    # The engine's plane rises towards its own +Y.
    turn_rad = math.radians(day.uphill_heading_deg)
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    x_m, y_m, _, yaw_rad = scenario.start_pose
    vehicle.reset((cos * x_m + sin * y_m, cos * y_m - sin * x_m, 0.0, yaw_rad - turn_rad), scenario.start_attitude_rad)
    noise = np.random.default_rng(day.seed)
    poses: deque[tuple[float, float, float, float, float]] = deque()
    commands, speeds = deque([(0.0, (0.0, 0.0))]), [0.0, 0.0]
    path, track = [], []
    cycle, next_pose_s, completed, place = 0, 0.0, False, np.array([x_m, y_m])
    while cycle * PERIOD_S < LONGEST_S:
        time_s = cycle * PERIOD_S
        right_m, up_m, z_m, yaw_rad = vehicle.pose
        place, yaw_rad = np.array([cos * right_m - sin * up_m, sin * right_m + cos * up_m]), yaw_rad + turn_rad
        drawn_now = noise.normal(size=6)
        if time_s > next_pose_s - 1e-9:
            next_pose_s += 1 / day.pose_rate_hz
            if not (day.gap_s and time_s % 15 > 15 - day.gap_s):
                x_m, y_m = place + day.noise_m * drawn_now[:2]
                poses.append((time_s, x_m, y_m, z_m, yaw_rad + day.bias_rad + day.noise_rad * drawn_now[2]))
        pose = poses.popleft() if poses and time_s - poses[0][0] > day.pose_delay_s - 1e-9 else None
        left_m_s, right_m_s = (round(speed / 0.01) * 0.01 for speed in vehicle.tread_speeds_m_s)
        roll_rad, pitch_rad = np.array(vehicle.attitude_rad) + math.radians(0.3) * drawn_now[3:5]
        decision = controller.step(
            time_s,
            tread_speeds_m_s=(left_m_s, right_m_s),
            attitude_rad=(roll_rad, pitch_rad),
            yaw_rate_rad_s=1.005 * vehicle.yaw_rate_rad_s + math.radians(0.2 + 0.1 * drawn_now[5]),
            pose=pose,
        )
        completed = decision.finished
        if completed or decision.status == "stopping":
            break
        if decision.reference_pose:
            path.append(decision.reference_pose[:2])
        if time_s > COUNTS_FROM_S:
            track.append(place)
        commands.append((time_s + day.delay_s, (decision.drive_traction_m_s, decision.drive_steer_m_s)))
        for step in range(round(PERIOD_S / STEP_S)):
            now_s = time_s + step * STEP_S
            while len(commands) > 1 and commands[1][0] <= now_s + 1e-9:
                commands.popleft()
            for k, motor in enumerate(day.motors):
                speeds[k] = motor.step(speeds[k], commands[0][1][k], now_s)
            vehicle.step(speeds[0] - speeds[1], speeds[0] + speeds[1], STEP_S)
        cycle += 1
    if not track or not path:
        return False, math.nan
    if day.course["shape"] == "pivot":
        return completed, math.dist(place, path[0])
    errors = [np.hypot(*(np.array(path) - there).T).min() for there in track]
    return completed, float(np.sqrt(np.mean(np.square(errors))))


def run(seed: int, number: int) -> tuple[bool, list[tuple[bool, float]]]:
    """Returns whether a run is a turn on the spot, and what the controllers do."""
    day = drawn(number, seed)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "vehicle.yaml"
        identified(Vehicle, day.measures).save(file)
        return day.course["shape"] == "pivot", [driven(day, file, kind) for kind in KINDS]


def share(errors: Sequence[float], part: float) -> str:
    """Returns the error, cm, that a part of runs does not exceed."""
    return f"{100 * sorted(errors)[min(len(errors) - 1, int(part * len(errors)))]:.2f}" if errors else "-"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with multiprocessing.Pool() as pool:
        runs = pool.map(partial(run, given.seed), range(given.runs), chunksize=1)
    print("| controller | completed | median | p95 | worst | turns on the spot: median | p90 |")
    for k, kind in enumerate(KINDS):
        done = [(is_turn, of_kinds[k][1]) for is_turn, of_kinds in runs if of_kinds[k][0]]
        drives, turns = [error for is_turn, error in done if not is_turn], [error for is_turn, error in done if is_turn]
        cells = [share(drives, part) for part in (0.5, 0.95, 1.0)] + [share(turns, part) for part in (0.5, 0.9)]
        print(f"| {kind} | {len(done)} of {given.runs} | {' | '.join(cells)} |")
    worse = sum(
        min(of_kinds[0][0], of_kinds[-1][0]) and of_kinds[0][1] > of_kinds[-1][1] + 0.02 for _, of_kinds in runs
    )
    print(f"{KINDS[0]} worse than {KINDS[-1]} by more than 2 cm: {worse}")


if __name__ == "__main__":
    main()
