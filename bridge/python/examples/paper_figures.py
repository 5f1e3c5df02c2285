"""Figures 2, 7 and 8 and Tables I and II of the paper from its models.

    python bridge/python/examples/paper_figures.py --out out

Figure 2: tread ICRs of the rover Lazaro that turns clockwise on a board at four tilts (the model's dots; the measured
ones are in the paper). Figure 7: three drives of the J8, with what dead reckoning by ICRIK and by ICRHK makes of them.
Figure 8: the slope along the third drive, true and as a noisy attitude sensor reads it. Table I: the parameters that
identification finds in simulated logs. Table II: errors of dead reckoning on the three drives with noisy readings.

The paper's logs are not public: the drives here are made by the exact ICRIK model, so ICRIK is the truth and what is
shown is the error of the model for level ground, in Table II also that of the readings.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import sidehill
from matplotlib.patches import Rectangle

Floats = npt.NDArray[np.float64]
Log = dict[str, Floats]

CONFIG = Path(__file__).resolve().parents[3] / "config"
# Of a lidar's poses, an attitude sensor and encoders: assumptions.
POSE_NOISE_M, YAW_NOISE_RAD, ATTITUDE_NOISE_RAD, ATTITUDE_OFFSET_RAD, SPEED_NOISE_M_S = 0.02, 0.005, 0.005, 0.003, 0.01
KEYS = ("correction_left", "correction_right", "x_icr_left_m", "x_icr_right_m", "y_icr_m", "lambda_1_s_per_rad",
        "lambda_2_s_per_rad")  # fmt: skip


def on_plane(slope_rad: float, yaw_rad: Floats) -> tuple[Floats, Floats]:
    """Returns exact (roll, pitch) at headings on a plane that rises towards +Y_g."""
    right, forward = -np.sin(yaw_rad) * np.sin(slope_rad), -np.cos(yaw_rad) * np.sin(slope_rad)
    return np.arctan2(right, np.cos(slope_rad)), -np.arcsin(forward)


def figure_2(out: Path) -> None:
    lazaro = sidehill.Vehicle.load(CONFIG / "vehicles/lazaro.yaml")
    axes = plt.subplots(4, 1, figsize=(6, 9), sharex=True, sharey=True, constrained_layout=True)[1]
    for axis, tilt_deg in zip(axes, (0, 2.5, 4.4, 7.6), strict=True):
        roll, pitch = on_plane(math.radians(tilt_deg), np.linspace(-np.pi, np.pi, 181))
        icrs = sidehill.icr(lazaro, roll, pitch, 0.21, -0.21)
        for side in ("left", "right"):
            axis.plot(icrs[f"x_icr_{side}_m"], icrs["y_icr_m"], "r.", markersize=3)
        half_width, half_length = lazaro.base_half_width_m, lazaro.base_half_length_m
        axis.add_patch(Rectangle((-half_width, -half_length), 2 * half_width, 2 * half_length, fill=False, color="b"))
        axis.set(aspect="equal", ylabel="y (m)", title=f"{tilt_deg} deg")
    axes[-1].set_xlabel("x (m)")
    plt.savefig(out / "figure_2.png", dpi=120)
    plt.close()


def dead_reckoned(log: Log, vehicle: sidehill.Vehicle, prefix: str) -> Floats:
    """Returns (x, y, z, yaw) of each row by equations (4) and (12), shape (4, n); `prefix` chooses the model."""
    roll, pitch = log["roll_rad"], log["pitch_rad"]
    speeds = log["v_left_m_s"] * vehicle.correction_left, log["v_right_m_s"] * vehicle.correction_right
    body = sidehill.icr(vehicle, roll, pitch, *speeds)
    v_x, v_y, omega = (body[prefix + name] for name in ("v_x_m_s", "v_y_m_s", "omega_z_rad_s"))
    step = np.diff(log["time_s"], append=log["time_s"][-1])
    # Equation (12) with R = Rz(yaw) Ry(roll) Rx(pitch).
    right = np.cos(roll) * v_x + np.sin(roll) * np.sin(pitch) * v_y
    forward = np.cos(pitch) * v_y
    up = -np.sin(roll) * v_x + np.sin(pitch) * np.cos(roll) * v_y
    rate = omega * np.cos(pitch) / np.cos(roll)
    yaw = log["yaw_rad"][0] + np.concatenate([[0], np.cumsum(step * rate)[:-1]])
    middle = yaw + 0.5 * step * rate
    x_rate, y_rate = np.cos(middle) * right - np.sin(middle) * forward, np.sin(middle) * right + np.cos(middle) * forward
    moved = [np.concatenate([[0], np.cumsum(step * each)[:-1]]) for each in (x_rate, y_rate, up)]
    start = [log[key][0] for key in ("x_m", "y_m", "z_m")]
    return np.vstack([np.add(np.array(start)[:, None], moved), yaw])


def rotation(vehicle: sidehill.Vehicle) -> Log:
    """Returns the first validation drive: V_l = -V_r = 0.3 m/s for 47.7 s on 3.6 deg."""
    scenario = sidehill.Scenario.load(CONFIG / "scenarios/figure_eight.yaml")
    dt_s, slope_rad = scenario.period_s, math.radians(3.6)
    x_m = y_m = yaw_rad = 0.0
    rows = []
    for step in range(round(47.7 / dt_s) + 1):
        roll, pitch = (float(angle) for angle in on_plane(slope_rad, np.array(yaw_rad)))
        rows.append((step * dt_s, 0.3 / vehicle.correction_left, -0.3 / vehicle.correction_right, roll, pitch,
                     x_m, y_m, y_m * math.tan(slope_rad), yaw_rad))  # fmt: skip
        body = {key: float(value) for key, value in sidehill.icr(vehicle, roll, pitch, 0.3, -0.3).items()}
        yaw_rad += dt_s * body["omega_z_rad_s"]
        x_m += dt_s * (math.cos(yaw_rad) * body["v_x_m_s"] - math.sin(yaw_rad) * body["v_y_m_s"])
        y_m += dt_s * (math.sin(yaw_rad) * body["v_x_m_s"] + math.cos(yaw_rad) * body["v_y_m_s"])
    names = ("time_s", "v_left_m_s", "v_right_m_s", "roll_rad", "pitch_rad", "x_m", "y_m", "z_m", "yaw_rad")
    return dict(zip(names, np.array(rows).T, strict=True))


def driven(name: str) -> Log:
    """Returns a scenario's drive by icrik-mpc with the columns of a log."""
    scenario = sidehill.Scenario.load(CONFIG / f"scenarios/{name}.yaml")
    log = sidehill.simulate(scenario, controllers=["icrik-mpc"]).runs[0].log
    vehicle = scenario.vehicle
    # In a row are the speeds that led to it; those of the next lead on from it.
    left = np.append((log["motor_traction_m_s"] - log["motor_steer_m_s"])[1:], 0) / vehicle.correction_left
    right = np.append((log["motor_traction_m_s"] + log["motor_steer_m_s"])[1:], 0) / vehicle.correction_right
    kept = {key: log[key] for key in ("time_s", "roll_rad", "pitch_rad", "x_m", "y_m", "z_m", "yaw_rad")}
    return kept | {"v_left_m_s": left, "v_right_m_s": right}


def drives(j8: sidehill.Vehicle) -> dict[str, Log]:
    """Returns the logs of the three validation drives."""
    return {
        "a: rotation, 3.6 deg": rotation(j8),
        "b: figure of eight, 5.3 deg": driven("figure_eight"),
        "c: three zones": driven("paper_3_zones"),
    }


def read(log: Log, random: np.random.Generator) -> Log:
    """Returns the log as an attitude sensor and encoders read it; poses stay true."""
    rows = len(log["time_s"])
    noisy = dict(log)
    for key in ("roll_rad", "pitch_rad"):
        noisy[key] = log[key] + ATTITUDE_OFFSET_RAD + random.normal(0, ATTITUDE_NOISE_RAD, rows)
    for key in ("v_left_m_s", "v_right_m_s"):
        noisy[key] = log[key] + random.normal(0, SPEED_NOISE_M_S, rows)
    return noisy


def figure_7(out: Path, logs: dict[str, Log]) -> dict[str, tuple[float, float]]:
    """Draws the drives and returns for each the largest errors of position of ICRIK and ICRHK, m."""
    j8 = sidehill.Vehicle.load(CONFIG / "vehicles/j8.yaml")
    errors = {}
    axes = plt.subplots(1, 3, figsize=(15, 5), constrained_layout=True)[1]
    for axis, (name, log) in zip(axes, logs.items(), strict=True):
        paths = {"ICRIK": dead_reckoned(log, j8, ""), "ICRHK": dead_reckoned(log, j8, "icrhk_")}
        axis.plot(log["x_m"], log["y_m"], "k", linewidth=3, label="true")
        for (model, path), colour in zip(paths.items(), ("tab:blue", "tab:orange"), strict=True):
            axis.plot(path[0], path[1], color=colour, label=model)
        axis.set(aspect="equal", adjustable="datalim", xlabel="x (m)", ylabel="y (m), uphill", title=name)
        axis.legend()
        icrik, icrhk = (np.hypot(path[0] - log["x_m"], path[1] - log["y_m"]).max() for path in paths.values())
        errors[name] = float(icrik), float(icrhk)
    plt.savefig(out / "figure_7.png", dpi=120)
    plt.close()
    return errors


def figure_8(out: Path, log: Log) -> dict[str, Floats]:
    """Draws the slope along a drive by equation (3), and returns it as it is and as it is read, deg, shape (n,)."""
    slopes = {
        name: np.degrees(np.hypot(each["roll_rad"], each["pitch_rad"]))
        for name, each in (("read", read(log, np.random.default_rng(1))), ("true", log))
    }
    axis = plt.subplots(figsize=(8, 3.5), constrained_layout=True)[1]
    for (name, slope), colour in zip(slopes.items(), ("0.7", "k"), strict=True):
        axis.plot(log["time_s"], slope, color=colour, label=name)
    axis.set(xlabel="time (s)", ylabel="beta (deg)")
    axis.legend()
    plt.savefig(out / "figure_8.png", dpi=120)
    plt.close()
    return slopes


def by_hand(vehicle: sidehill.Vehicle, slope_deg: float, speeds: Iterator[tuple[float, float]], seed: int) -> Log:
    """Returns a noisy log at 20 Hz of a drive with these speeds (left, right), m/s, for 10 s each."""
    scenario = sidehill.Scenario(
        vehicle=vehicle,
        course={"shape": "straight", "length_m": 2, "speed_m_s": 0.5},
        terrain={"kind": "plane", "slope_deg": slope_deg, "uphill_heading_deg": 0},
    )
    simulation = sidehill.Simulation(scenario)
    rows: list[tuple[float, ...]] = []
    for left, right in (pair for pair in speeds for _ in range(200)):
        rows.append((simulation.time_s, *simulation.pose, *simulation.attitude_rad, left, right))
        simulation.step(left, right, 0.05)
    names = ("time_s", "x_m", "y_m", "z_m", "yaw_rad", "roll_rad", "pitch_rad", "v_left_m_s", "v_right_m_s")
    log: Log = dict(zip(names, np.array(rows).T, strict=True))
    random = np.random.default_rng(seed)
    for key, deviation in (("x_m", POSE_NOISE_M), ("y_m", POSE_NOISE_M), ("z_m", POSE_NOISE_M), ("yaw_rad", YAW_NOISE_RAD),
                           ("roll_rad", ATTITUDE_NOISE_RAD), ("pitch_rad", ATTITUDE_NOISE_RAD)):  # fmt: skip
        log[key] = log[key] + random.normal(0, deviation, len(rows))
    return log


def table_1() -> dict[str, tuple[float, float, float]]:
    """Returns of each parameter the paper's value, what identification finds and its 95 % half width.

    As in section III-B: drives of several speeds and radii on level ground, then one turn on the spot at 0.33 m/s on 4 deg.
    """
    j8 = sidehill.Vehicle.load(CONFIG / "vehicles/j8.yaml")
    radii = ((v - steer, v + steer) for v in (0.3, 0.6, -0.4) for steer in (-0.3, -0.1, 0.0, 0.2, 0.4))
    found = sidehill.identify(
        level=[by_hand(j8, 0, radii, seed=1)],
        slope=[by_hand(j8, 4, iter([(-0.33, 0.33)] * 12), seed=2)],
        vehicle=j8.with_(x_icr_left_m=-0.8, x_icr_right_m=0.8, y_icr_m=0, correction_left=1, correction_right=1,
                         lambda_1_s_per_rad=0.5, lambda_2_s_per_rad=1),
        segment_s=8,
    )  # fmt: skip
    estimates: dict[str, Any] = {}
    for stage in (found.level, found.slope):
        estimates |= stage["estimates"] if stage else {}
    return {key: (getattr(j8, key), estimates[key]["value"], estimates[key]["half_width_95"]) for key in KEYS}


def table_2(logs: dict[str, Log]) -> dict[str, dict[str, list[float]]]:
    """Returns for each drive and model the mean squared errors in x, y, z (m^2) and yaw (rad^2), and J/N, equation (13).

    As in the paper there is a pose every 0.1 s, every second row.
    """
    j8 = sidehill.Vehicle.load(CONFIG / "vehicles/j8.yaml")
    random = np.random.default_rng(1)
    table: dict[str, dict[str, list[float]]] = {}
    for name, log in logs.items():
        noisy = read(log, random)
        true = np.vstack([log[key] for key in ("x_m", "y_m", "z_m", "yaw_rad")])
        table[name] = {}
        for model, prefix in (("ICRHK", "icrhk_"), ("ICRIK", "")):
            error = dead_reckoned(noisy, j8, prefix) - true
            error[3] = np.remainder(error[3] + np.pi, 2 * np.pi) - np.pi
            squares = (error[:, ::2] ** 2).mean(1)
            table[name][model] = [*map(float, squares), float(squares.sum())]
    return table


def main(out: Path) -> dict[str, tuple[float, float]]:
    out.mkdir(parents=True, exist_ok=True)
    logs = drives(sidehill.Vehicle.load(CONFIG / "vehicles/j8.yaml"))
    figure_2(out)
    errors = figure_7(out, logs)
    figure_8(out, logs["c: three zones"])
    for name, (icrik, icrhk) in errors.items():
        print(f"{name}: largest error of dead reckoning by ICRIK {icrik:.3f} m, by ICRHK {icrhk:.3f} m")
    print(f"\nTable I{'':15}{'paper':>10}{'found':>10}{'+-':>10}")
    for key, values in table_1().items():
        print(f"{key:22}" + "".join(f"{value:10.3f}" for value in values))
    print(f"\nTable II{'':28}{'x':>10}{'y':>10}{'z':>10}{'yaw':>10}{'J/N':>10}")
    for name, models in table_2(logs).items():
        for model, row in models.items():
            print(f"{name:30}{model:6}" + "".join(f"{value:10.4f}" for value in row))
    return errors


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    main(parser.parse_args().out)
