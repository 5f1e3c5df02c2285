"""Controllers on vehicles in MuJoCo, physics that none of them predicts with.

    python bridge/python/benches/mujoco_vehicles.py [--realistic SEEDS]

Vehicles of four, six and eight wheels on springs, whose point contacts have dry friction, drive a figure of eight on
slopes. The drives hold their speed, and the wheels of a side are coupled, as by a chain. The controllers know geometry, and
what `sidehill.identify` finds in two drives; `contact-mpc` starts from the axles' places and the ICRs of these. The table has
the cross-track RMS after the first 2 s in cm, and the total variation of steer in m/s; a run that was stopped has a cross.

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
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import sidehill

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from rover import MujocoRover

CONTROLLERS = ("contact-mpc", "icrik-mpc", "icrhk-mpc")
SLOPES_DEG = (5.3, 10.0, 15.0)
GRAVITY_M_S2 = 9.81
SUBSTEP_S = 0.002
PERIOD_S = 0.05
# Of the springs under the weight that they carry, Hz; the heaviest axles are the stiffest.
SPRINGS_HZ = 6.0
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


def model(measures: Measures, slope_deg: float) -> mujoco.MjModel:
    """Returns the vehicle on a slope that rises towards +Y_g."""
    mass, radius, axles = measures.mass_kg, measures.wheel_radius_m, measures.axles_m
    wheels = actuators = couplings = ""
    wheel_kg = 0.02 * mass
    body_kg = mass - 2 * len(axles) * wheel_kg
    for side, right_m in (("left", -measures.half_width_m), ("right", measures.half_width_m)):
        for axle, (forward_m, share) in enumerate(zip(axles, measures.load_shares, strict=True)):
            load_n = 0.5 * share * mass * GRAVITY_M_S2
            sag_m = GRAVITY_M_S2 / (2 * math.pi * SPRINGS_HZ) ** 2
            stiffness = load_n / sag_m
            damping = 1.4 * load_n / GRAVITY_M_S2 * 2 * math.pi * SPRINGS_HZ
            wheels += f"""
      <body name="{side}_{axle}" pos="{right_m} {forward_m} 0">
        <joint type="slide" axis="0 0 1" stiffness="{stiffness}" damping="{damping}" springref="{-sag_m}"/>
        <joint name="{side}_{axle}" axis="-1 0 0" damping="{0.01 * mass * radius}"
               armature="{4 * mass * radius**2 / (2 * len(axles))}"/>
        <geom type="ellipsoid" size="{0.5 * measures.wheel_width_m} {radius} {radius}" mass="{wheel_kg}"
              friction="{measures.friction} 0.005 0.0001"/>
      </body>"""
            servo = 2000 * mass * radius**2 / len(axles)
            actuators += f'<velocity joint="{side}_{axle}" kv="{servo}"/>'
            if axle > 0:
                couplings += f"""
    <joint joint1="{side}_0" joint2="{side}_{axle}" solref="0.004 1" solimp="0.99 0.999 0.001"/>"""
    right_m, forward_m, height_m = measures.centre_of_mass_m
    length, width = 1.8 * max(axles), 1.8 * measures.half_width_m
    inertias = body_kg / 12 * np.array([length**2 + 0.09, width**2 + 0.09, length**2 + width**2])
    # The wheels' own mass is at their hubs.
    over = mass / body_kg
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{SUBSTEP_S}" integrator="implicitfast" cone="elliptic" impratio="20"/>
  <default><geom solref="0.01 1"/></default>
  <worldbody>
    <geom type="plane" size="40 40 0.1" euler="{slope_deg} 0 0" friction="{measures.friction} 0.005 0.0001"/>
    <body name="rover">
      <freejoint/>
      <inertial pos="{right_m * over} {forward_m * over} {(height_m - radius) * over}" mass="{body_kg}"
                diaginertia="{inertias[0]} {inertias[1]} {inertias[2]}"/>
{wheels}
    </body>
  </worldbody>
  <equality>{couplings}</equality>
  <actuator>{actuators}</actuator>
</mujoco>""")


class Vehicle(MujocoRover):
    """One of the vehicles: the plant of `sidehill.simulate`."""

    def __init__(self, measures: Measures, slope_deg: float) -> None:
        self.model = model(measures, slope_deg)
        self.data = mujoco.MjData(self.model)
        self.slope_rad = math.radians(slope_deg)
        self.radius_m, self.side = measures.wheel_radius_m, len(measures.axles_m)
        names = [f"{side}_{axle}" for side in ("left", "right") for axle in range(self.side)]
        self._rates = [self.model.joint(name).dofadr[0] for name in names]

    @property
    def _wheel_rates_rad_s(self) -> np.ndarray:
        return self.data.qvel[self._rates]

    def reset(self, pose: tuple[float, ...], attitude: tuple[float, ...]) -> None:
        super().reset(pose, attitude)
        # Back to where it was put: it has rolled while it sank into its springs.
        x_m, y_m, _, _ = self.pose
        right_m, up_m = pose[0] - x_m, pose[1] - y_m
        self.data.qpos[:3] += [right_m, up_m, up_m * math.tan(self.slope_rad)]
        mujoco.mj_forward(self.model, self.data)

    @property
    def yaw_rate_rad_s(self) -> float:
        """About the body's upward axis."""
        return float(self.data.qvel[5])


def identified(measures: Measures) -> sidehill.Vehicle:
    """Returns what a drive on level ground and one on 6 deg tell, with the axles' places for `contact-mpc`."""
    half_width_m = measures.half_width_m
    guess = sidehill.Vehicle.from_dict({
        "name": "mujoco-vehicle",
        "x_icr_left_m": -2 * half_width_m, "x_icr_right_m": 2 * half_width_m, "y_icr_m": 0.0,
        "lambda_1_s_per_rad": 1.0, "lambda_2_s_per_rad": 1.0, "speed_max_m_s": 1.0,
        "base_half_width_m": half_width_m, "base_half_length_m": max(measures.axles_m),
        "correction_left": 1.0, "correction_right": 1.0,
    })  # fmt: skip
    turns = [(8.0, 0.3, 0.3), (10.0, 0.1, 0.4), (10.0, 0.4, 0.15), (8.0, -0.2, -0.35), (10.0, -0.25, 0.25),
             (8.0, 0.2, -0.2), (8.0, 0.45, 0.2)]  # fmt: skip
    spins = [(20.0, -0.25, 0.25), (20.0, 0.2, -0.2), (15.0, 0.1, 0.4), (15.0, 0.4, 0.1)]
    level, slope = Vehicle(measures, 0.0), Vehicle(measures, 6.0)
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
    "weights": {"steer_change_s3_per_m2": 0.8, "heading_per_rad2": 0.4},
    "estimator": {
        "pose_sigma_m": 0.01, "pose_sigma_rad": 0.0087, "gate": 100, "normal_filter_s": 0.5,
        "slide_sigma_m_per_sqrt_s": 0.005, "yaw_sigma_rad_per_sqrt_s": 0.005,
        "adaptation": {"slope_sigma": 0.4, "forgetting_per_m": 0.05}, "contact": {"friction_forgetting_per_m": 0.2},
    },
}  # fmt: skip


def course(measures: Measures) -> dict[str, float | str]:
    half_width_m, half_length_m = 2.4 * measures.course, 3.9 * measures.course
    return {
        "shape": "figure_eight", "half_width_m": half_width_m, "half_length_m": half_length_m,
        "period_s": measures.period_s,
    }  # fmt: skip


def scenario(measures: Measures, vehicle: Path, slope_deg: float, realistic: bool) -> sidehill.Scenario:
    return sidehill.Scenario.from_dict({
        "name": "mujoco_eight", "vehicle": vehicle, "course": course(measures),
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

    def of(self, vehicle: Vehicle, time_s: float) -> dict:
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

    def drive(self, vehicle: Vehicle, command: tuple[float, float]) -> None:
        self.in_flight.append(command)
        wanted = np.array(self.in_flight.popleft())
        step_s = 0.01
        for _ in range(round(PERIOD_S / step_s)):
            self.speeds = wanted + math.exp(-step_s / 0.15) * (self.speeds - wanted)
            vehicle.step(float(self.speeds[0]), float(self.speeds[1]), step_s)


def realistic(scenario: sidehill.Scenario, measures: Measures, slope_deg: float, kind: str, seed: int) -> dict:
    """Returns the figures of a drive with realistic readings and drives."""
    vehicle, controller = Vehicle(measures, slope_deg), sidehill.Controller(scenario, kind=kind)
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


def drive(job: tuple[str, Path, float, int | None]) -> tuple[str, float, list[dict]]:
    """Returns the figures of all controllers on a vehicle and a slope; `None` for a seed: perfect readings."""
    name, file, slope_deg, seed = job
    measures = VEHICLES[name]
    of_job = scenario(measures, file, slope_deg, seed is not None)
    if seed is None:
        runs = sidehill.simulate(of_job, plant=Vehicle(measures, slope_deg)).metrics["runs"]
    else:
        runs = [realistic(of_job, measures, slope_deg, kind, seed) for kind in CONTROLLERS]
    return name, slope_deg, runs


def shown(runs: list[dict]) -> str:
    """Returns the median of runs of one controller, and how many were not completed."""
    rms = float(np.median([100 * run["cross_track_rms_m"] if run["completed"] else math.inf for run in runs]))
    variation = float(np.median([run["steer_total_variation_m_s"] for run in runs]))
    stopped = sum(not run["completed"] for run in runs)
    return f"{rms:.2f} ({variation:.1f})" + (f" [{stopped} of {len(runs)} stopped]" if stopped else "")


def main(names: list[str], slopes_deg: list[float], seeds: int) -> dict[tuple[str, float], list[list[dict]]]:
    """Prints the table and returns the runs of each row."""
    table: dict[tuple[str, float], list[list[dict]]] = {}
    with tempfile.TemporaryDirectory() as folder, multiprocessing.Pool() as pool:
        files = [Path(folder) / f"{number}.yaml" for number in range(len(names))]
        measures = [VEHICLES[name] for name in names]
        for vehicle, file in zip(pool.map(identified, measures), files, strict=True):
            vehicle.save(file)
        jobs = [
            (name, file, slope_deg, seed)
            for name, file in zip(names, files, strict=True)
            for slope_deg in slopes_deg
            for seed in (range(seeds) if seeds else [None])
        ]
        print(f"| vehicle | slope | {' | '.join(CONTROLLERS)} |")
        for name, slope_deg, runs in pool.imap(drive, jobs):
            row = table.setdefault((name, slope_deg), [])
            row.append(runs)
            if len(row) == max(seeds, 1):
                cells = [shown([runs[k] for runs in row]) for k in range(len(CONTROLLERS))]
                print(f"| {name} | {slope_deg:g} deg | {' | '.join(cells)} |", flush=True)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--vehicle", action="append", choices=list(VEHICLES), help="instead of all")
    parser.add_argument("--slope", action="append", type=float, help="deg, instead of 5.3, 10 and 15")
    parser.add_argument("--realistic", type=int, default=0, metavar="SEEDS", help="realistic readings, so many drives")
    given = parser.parse_args()
    main(given.vehicle or list(VEHICLES), given.slope or list(SLOPES_DEG), given.realistic)
