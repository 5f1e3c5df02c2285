"""Vehicles, drives and tables that the benches of physics engines share: mujoco_vehicles.py and drake_vehicles.py.

Vehicles of four, six and eight wheels with dry friction drive a figure of eight on slopes. The drives hold their speed, and
the wheels of a side are coupled, as by a chain. The controllers know geometry, and what `sidehill.identify` finds in two
drives; `contact-mpc` starts from the axles' places and the ICRs of these. The table has the cross-track RMS after the first
2 s in cm, and the total variation of steer in m/s; a run that was stopped counts as worse than all others.

With `--realistic` readings and drives are those of config/conditions/realistic.yaml: poses at 10 Hz, 100 ms late, with noise
of 1 cm and 0.5 deg, attitudes with 0.3 deg, a gyroscope, commands 100 ms late, motors with a lag of 0.15 s. Friction is
even.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
import tempfile
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import sidehill

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from body import Body

CONTROLLERS: tuple[sidehill.Kind, ...] = ("contact-mpc", "icrik-mpc", "icrhk-mpc", "pure-pursuit")
SLOPES_DEG = (5.3, 10.0, 15.0)
GRAVITY_M_S2 = 9.81
PERIOD_S = 0.05
# Of the springs under the weight that they carry, Hz; the heaviest axles are the stiffest.
SPRINGS_HZ = 6.0
# How far they give way under it.
SAG_M = GRAVITY_M_S2 / (2 * math.pi * SPRINGS_HZ) ** 2
# Seconds after which errors count.
COUNTS_FROM_S = 2.0


@dataclass(frozen=True)
class Measures:
    """A vehicle on wheels; lengths in m from the middle of the wheels on the ground, right, forward and up."""

    mass_kg: float
    wheel_radius_m: float
    wheel_width_m: float
    half_width_m: float
    axles_m: tuple[float, ...]
    load_shares: tuple[float, ...]
    centre_of_mass_m: tuple[float, float, float]
    friction: float
    # Of the course, over that of the project's figure of eight, and time for a lap, s.
    course: float
    period_s: float


J8 = Measures(
    mass_kg=1090, wheel_radius_m=0.34, wheel_width_m=0.25, half_width_m=0.6, axles_m=(1.06, 0.353, -0.353, -1.06),
    load_shares=(0.1285, 0.3715, 0.3715, 0.1285), centre_of_mass_m=(-0.034, 0.193, 0.4), friction=0.8,
    course=1.0, period_s=60.0,
)  # fmt: skip
VEHICLES = {
    "J8": J8,
    "J8, centre of mass 0.7 m high": replace(J8, centre_of_mass_m=(-0.034, 0.193, 0.7)),
    "J8, centre of mass 0.45 m ahead": replace(J8, centre_of_mass_m=(0.0, 0.45, 0.4)),
    "J8, friction 0.5": replace(J8, friction=0.5),
    "J8, equal axle loads": replace(J8, load_shares=(0.25,) * 4, centre_of_mass_m=(0.0, 0.1, 0.4)),
    "six wheels, 300 kg": Measures(
        mass_kg=300, wheel_radius_m=0.25, wheel_width_m=0.18, half_width_m=0.45, axles_m=(0.6, 0.0, -0.6),
        load_shares=(0.25, 0.5, 0.25), centre_of_mass_m=(0.03, -0.05, 0.35), friction=0.7, course=0.75, period_s=52.0,
    ),
    "four wheels, 60 kg": Measures(
        mass_kg=60, wheel_radius_m=0.165, wheel_width_m=0.1, half_width_m=0.285, axles_m=(0.256, -0.256),
        load_shares=(0.5, 0.5), centre_of_mass_m=(0.01, 0.02, 0.2), friction=0.7, course=0.5, period_s=40.0,
    ),
}  # fmt: skip


class Gyroscope(Body):
    """A body that measures its yaw rate, too."""

    @property
    def yaw_rate_rad_s(self) -> float:
        """About the body's upward axis."""
        raise NotImplementedError


# A vehicle of measures, on a slope in deg.
Engine = Callable[[Measures, float], Gyroscope]


def identified(engine: Engine, measures: Measures) -> sidehill.Vehicle:
    """Returns what a drive on level ground and one on 6 deg tell, with the axles' places for `contact-mpc`."""
    half_width_m = measures.half_width_m
    guess = sidehill.Vehicle.from_dict({
        "name": "vehicle",
        "x_icr_left_m": -2 * half_width_m, "x_icr_right_m": 2 * half_width_m, "y_icr_m": 0.0,
        "lambda_1_s_per_rad": 1.0, "lambda_2_s_per_rad": 1.0, "speed_max_m_s": 1.0,
        "base_half_width_m": half_width_m, "base_half_length_m": max(measures.axles_m),
        "correction_left": 1.0, "correction_right": 1.0,
    })  # fmt: skip
    turns = [(8.0, 0.3, 0.3), (10.0, 0.1, 0.4), (10.0, 0.4, 0.15), (8.0, -0.2, -0.35), (10.0, -0.25, 0.25),
             (8.0, 0.2, -0.2), (8.0, 0.45, 0.2)]  # fmt: skip
    spins = [(20.0, -0.25, 0.25), (20.0, 0.2, -0.2), (15.0, 0.1, 0.4), (15.0, 0.4, 0.1)]
    level, slope = engine(measures, 0.0), engine(measures, 6.0)
    level.reset((0, 0, 0, 0), (0, 0))
    slope.reset((0, 0, 0, 0), (0, math.radians(6)))
    found = sidehill.identify(level=[level.drive(turns)], slope=[slope.drive(spins)], vehicle=guess, segment_s=4)
    axles = [{"forward_m": forward_m} for forward_m in measures.axles_m]
    keys = found.vehicle.to_dict() | {"contact": {"half_width_m": half_width_m, "axles": axles}}
    return sidehill.Vehicle.from_dict(keys)


# What controllers are told of realistic conditions: as in config/conditions/realistic.yaml.
REALISTIC = {
    "command_delay_s": 0.1,
    "motor_lag_s": 0.15,
    "limits": {
        "traction": {"speed_m_s": 1.0, "acceleration_m_s2": 0.52, "deceleration_m_s2": 2.0},
        "steer": {"speed_m_s": 1.0, "acceleration_m_s2": 2.0, "deceleration_m_s2": 2.0},
        "tread_speed_m_s": 2.0,
    },
    "estimator": {
        "pose_sigma_m": 0.01,
        "pose_sigma_rad": 0.0087,
        "slide_sigma_m_per_sqrt_s": 0.005,
        "yaw_sigma_rad_per_sqrt_s": 0.005,
    },
}


def course(measures: Measures) -> dict[str, float | str]:
    half_width_m, half_length_m = 2.4 * measures.course, 3.9 * measures.course
    return {
        "shape": "figure_eight", "half_width_m": half_width_m, "half_length_m": half_length_m,
        "period_s": measures.period_s,
    }  # fmt: skip


def scenario(measures: Measures, vehicle: Path, slope_deg: float, realistic: bool) -> sidehill.Scenario:
    return sidehill.Scenario.from_dict({
        "name": "eight", "vehicle": vehicle, "course": course(measures),
        "terrain": {"kind": "plane", "slope_deg": slope_deg, "uphill_heading_deg": 0},
        "controllers": list(CONTROLLERS), "plant": "icrik", "seed": 1, "step_s": 0.01,
        "controller": REALISTIC if realistic else {},
    })  # fmt: skip


class Readings:
    """Readings of a vehicle as `realistic` has them, from its true state once a cycle."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.poses: deque[tuple[float, ...]] = deque()
        self.cycle = 0

    def of(self, vehicle: Gyroscope, time_s: float) -> dict[str, Any]:
        x_m, y_m, z_m, yaw_rad = vehicle.pose
        noise = self.random.normal(size=7)
        if self.cycle % 2 == 0:
            turned = yaw_rad + math.radians(0.5) * noise[2]
            self.poses.append((time_s, x_m + 0.01 * noise[0], y_m + 0.01 * noise[1], z_m, turned))
        self.cycle += 1
        due = self.poses and time_s - self.poses[0][0] > 0.1 - 1e-9
        roll, pitch = vehicle.attitude_rad
        return {
            "tread_speeds_m_s": tuple(round(speed / 0.01) * 0.01 for speed in vehicle.tread_speeds_m_s),
            "attitude_rad": (roll + math.radians(0.3) * noise[3], pitch + math.radians(0.3) * noise[4]),
            "yaw_rate_rad_s": 1.005 * vehicle.yaw_rate_rad_s + math.radians(0.2 + 0.1 * noise[5]),
            "pose": self.poses.popleft() if due else None,
        }


class Motors:
    """Commands 100 ms late, followed with a lag of 0.15 s."""

    def __init__(self) -> None:
        self.in_flight = deque([(0.0, 0.0)] * round(0.1 / PERIOD_S))
        self.speeds = np.zeros(2)

    def drive(self, vehicle: Gyroscope, command: tuple[float, float]) -> None:
        self.in_flight.append(command)
        wanted = np.array(self.in_flight.popleft())
        step_s = 0.01
        for _ in range(round(PERIOD_S / step_s)):
            self.speeds = wanted + math.exp(-step_s / 0.15) * (self.speeds - wanted)
            vehicle.step(float(self.speeds[0]), float(self.speeds[1]), step_s)


def realistic(vehicle: Gyroscope, scenario: sidehill.Scenario, measures: Measures, kind: sidehill.Kind, seed: int) -> dict[str, Any]:
    """Returns the figures of a drive with realistic readings and drives."""
    controller = sidehill.Controller(scenario, kind=kind)
    vehicle.reset(scenario.start_pose, scenario.start_attitude_rad)
    readings, motors = Readings(seed), Motors()
    angle = np.linspace(0, 2 * math.pi, 20_001)
    shape = course(measures)
    path = np.column_stack([shape["half_width_m"] * np.sin(2 * angle), shape["half_length_m"] * np.sin(angle)])
    time_s, variation, before, errors = 0.0, 0.0, 0.0, []
    while True:
        decision = controller.step(time_s, **readings.of(vehicle, time_s))
        if decision.finished or decision.status == "stopping":
            break
        variation += abs(decision.steer_m_s - before)
        before = decision.steer_m_s
        traction, steer = decision.drive_traction_m_s, decision.drive_steer_m_s
        motors.drive(vehicle, (traction - steer, traction + steer))
        time_s += PERIOD_S
        if time_s > COUNTS_FROM_S:
            errors.append(np.hypot(*(path - vehicle.pose[:2]).T).min())
    return {
        "controller": kind,
        "cross_track_rms_m": float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan,
        "steer_total_variation_m_s": variation,
        "completed": decision.finished,
    }


Job = tuple[Engine, str, Measures, Path, float, int | None]
Table = dict[tuple[str, float], list[list[dict[str, Any]]]]


def drive(job: Job) -> tuple[str, float, list[dict[str, Any]]]:
    """Returns the figures of all controllers on a vehicle and a slope; `None` for a seed: perfect readings."""
    engine, name, measures, file, slope_deg, seed = job
    of_job, vehicle = scenario(measures, file, slope_deg, seed is not None), engine(measures, slope_deg)
    if seed is None:
        runs = sidehill.simulate(of_job, plant=vehicle).metrics["runs"]
    else:
        runs = [realistic(vehicle, of_job, measures, kind, seed) for kind in CONTROLLERS]
    return name, slope_deg, runs


def shown(runs: list[dict[str, Any]]) -> str:
    """Returns the median of runs of one controller, and how many were not completed."""
    rms = float(np.median([100 * run["cross_track_rms_m"] if run["completed"] else math.inf for run in runs]))
    variation = float(np.median([run["steer_total_variation_m_s"] for run in runs]))
    stopped = sum(not run["completed"] for run in runs)
    figure = "-" if math.isinf(rms) else f"{rms:.2f}"
    return f"{figure} ({variation:.1f})" + (f" [{stopped} of {len(runs)} stopped]" if stopped else "")


def table(engine: Engine, vehicles: dict[str, Measures], slopes_deg: list[float], seeds: int) -> Table:
    """Prints the table and returns the runs of each row; no seeds: perfect readings."""
    rows: Table = {}
    with tempfile.TemporaryDirectory() as folder, multiprocessing.Pool() as pool:
        files = [Path(folder) / f"{number}.yaml" for number in range(len(vehicles))]
        for vehicle, file in zip(pool.map(partial(identified, engine), vehicles.values()), files, strict=True):
            vehicle.save(file)
        jobs: list[Job] = [
            (engine, name, measures, file, slope_deg, seed)
            for (name, measures), file in zip(vehicles.items(), files, strict=True)
            for slope_deg in slopes_deg
            for seed in (range(seeds) if seeds else [None])
        ]
        print(f"| vehicle | slope | {' | '.join(CONTROLLERS)} |")
        for name, slope_deg, runs in pool.imap(drive, jobs):
            row = rows.setdefault((name, slope_deg), [])
            row.append(runs)
            if len(row) == max(seeds, 1):
                cells = [shown([runs[k] for runs in row]) for k in range(len(CONTROLLERS))]
                print(f"| {name} | {slope_deg:g} deg | {' | '.join(cells)} |", flush=True)
    return rows


def check(engine: Engine, measures: Measures) -> None:
    """Asserts what physics leaves no choice about: a vehicle that stands, slides, drives straight and turns."""
    limit_deg = math.degrees(math.atan(measures.friction))

    def started(slope_deg: float) -> Gyroscope:
        """Returns a vehicle that points across the slope."""
        vehicle = engine(measures, slope_deg)
        vehicle.reset((0, 0, 0, -math.pi / 2), (math.radians(slope_deg), 0))
        return vehicle

    def driven(vehicle: Gyroscope, left_m_s: float, right_m_s: float) -> tuple[float, float]:
        """Metres and radians of the next second."""
        x_m, y_m, _, yaw_rad = vehicle.pose
        vehicle.step(left_m_s, right_m_s, 1.0)
        return math.dist((x_m, y_m), vehicle.pose[:2]), vehicle.pose[3] - yaw_rad

    standing_m = driven(started(limit_deg - 4), 0, 0)[0]
    print(f"standing, 4 deg below the angle of friction: {1000 * standing_m:.2f} mm/s")
    assert standing_m < 0.002

    sliding = started(limit_deg + 4)
    first_m, second_m = driven(sliding, 0, 0)[0], driven(sliding, 0, 0)[0]
    slope_rad = math.radians(limit_deg + 4)
    # Poses are seen from above.
    gains_m_s2 = (second_m - first_m) / math.cos(slope_rad)
    expected = GRAVITY_M_S2 * (math.sin(slope_rad) - measures.friction * math.cos(slope_rad))
    print(f"sliding, 4 deg above: {gains_m_s2:.3f} m/s^2, {expected:.3f} of Coulomb's law")
    assert abs(gains_m_s2 / expected - 1) < 0.05

    straight = started(0)
    driven(straight, 0.4, 0.4)
    metres, turned = driven(straight, 0.4, 0.4)
    tread_m = sum(straight.tread_speeds_m_s) / 2
    print(f"straight: {metres / tread_m:.4f} of the treads' speed, {turned:.4f} rad/s")
    assert abs(metres / tread_m - 1) < 0.01 and abs(turned) < 0.002

    turning = started(0)
    driven(turning, -0.2, 0.2)
    _, turned = driven(turning, -0.2, 0.2)
    flat = (turning.tread_speeds_m_s[1] - turning.tread_speeds_m_s[0]) / (2 * measures.half_width_m)
    print(f"turning on the spot: {turned / flat:.3f} of the yaw rate without slip")
    assert 0.2 < turned / flat < 0.95


def main(doc: str, engine: Engine) -> None:
    """The program of a bench, with the options that benches share."""
    parser = argparse.ArgumentParser(description=doc.partition("\n")[0])
    parser.add_argument("--vehicle", action="append", choices=list(VEHICLES), help="instead of all")
    parser.add_argument("--friction", action="append", type=float, help="instead of that of the vehicles")
    parser.add_argument("--slope", action="append", type=float, help="deg, instead of 5.3, 10 and 15")
    parser.add_argument("--realistic", type=int, default=0, metavar="SEEDS", help="realistic readings, so many drives")
    parser.add_argument("--check", action="store_true", help="check the physics of the vehicles, and drive no course")
    given = parser.parse_args()
    vehicles = {name: VEHICLES[name] for name in given.vehicle or VEHICLES}
    if given.friction:
        vehicles = {
            f"{name}, friction {friction:g}": replace(measures, friction=friction)
            for name, measures in vehicles.items()
            for friction in given.friction
        }
    if given.check:
        for name, measures in vehicles.items():
            print(name)
            check(engine, measures)
    else:
        table(engine, vehicles, given.slope or list(SLOPES_DEG), given.realistic)
