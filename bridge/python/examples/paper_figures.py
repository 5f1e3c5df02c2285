"""Figures 2 and 7 of the paper from its models.

    python bridge/python/examples/paper_figures.py --out out

Figure 2: tread ICRs of the rover Lazaro that turns clockwise on a board at four tilts (the model's dots; the measured
ones are in the paper). Figure 7: three drives of the J8, with what dead reckoning by ICRIK and by ICRHK makes of them.
The paper's logs are not public: the drives here are made by the exact ICRIK model, so ICRIK is the truth and what is
shown is the error of the model for level ground.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import sidehill

CONFIG = Path(__file__).resolve().parents[3] / "config"


def on_plane(slope_rad: float, yaw_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
        axis.add_patch(plt.Rectangle((-half_width, -half_length), 2 * half_width, 2 * half_length, fill=False, color="b"))
        axis.set(aspect="equal", ylabel="y (m)", title=f"{tilt_deg} deg")
    axes[-1].set_xlabel("x (m)")
    plt.savefig(out / "figure_2.png", dpi=120)
    plt.close()


def dead_reckoned(log: dict[str, np.ndarray], vehicle: sidehill.Vehicle, prefix: str) -> np.ndarray:
    """Returns (x, y, yaw) of each row by equations (4) and (12); `prefix` chooses the model."""
    speeds = log["v_left_m_s"] * vehicle.correction_left, log["v_right_m_s"] * vehicle.correction_right
    body = sidehill.icr(vehicle, log["roll_rad"], log["pitch_rad"], *speeds)
    v_x, v_y, omega = (body[prefix + name] for name in ("v_x_m_s", "v_y_m_s", "omega_z_rad_s"))
    step = np.diff(log["time_s"], append=log["time_s"][-1])
    # Equation (12) with R = Rz(yaw) Ry(roll) Rx(pitch), in the horizontal plane.
    right = np.cos(log["roll_rad"]) * v_x + np.sin(log["roll_rad"]) * np.sin(log["pitch_rad"]) * v_y
    forward = np.cos(log["pitch_rad"]) * v_y
    rate = omega * np.cos(log["roll_rad"]) / np.cos(log["pitch_rad"])
    yaw = log["yaw_rad"][0] + np.concatenate([[0], np.cumsum(step * rate)[:-1]])
    middle = yaw + 0.5 * step * rate
    x = np.cumsum(step * (np.cos(middle) * right - np.sin(middle) * forward))
    y = np.cumsum(step * (np.sin(middle) * right + np.cos(middle) * forward))
    start = [[log["x_m"][0]], [log["y_m"][0]]]
    return np.vstack([start + np.vstack([np.append(0, x[:-1]), np.append(0, y[:-1])]), yaw])


def rotation(vehicle: sidehill.Vehicle) -> dict[str, np.ndarray]:
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


def driven(name: str) -> dict[str, np.ndarray]:
    """Returns a scenario's drive by icrik-mpc with the columns of a log."""
    scenario = sidehill.Scenario.load(CONFIG / f"scenarios/{name}.yaml")
    log = sidehill.simulate(scenario, controllers=["icrik-mpc"]).runs[0].log
    vehicle = scenario.vehicle
    # In a row are the speeds that led to it; those of the next lead on from it.
    left = np.append((log["motor_traction_m_s"] - log["motor_steer_m_s"])[1:], 0) / vehicle.correction_left
    right = np.append((log["motor_traction_m_s"] + log["motor_steer_m_s"])[1:], 0) / vehicle.correction_right
    kept = {key: log[key] for key in ("time_s", "roll_rad", "pitch_rad", "x_m", "y_m", "z_m", "yaw_rad")}
    return kept | {"v_left_m_s": left, "v_right_m_s": right}


def figure_7(out: Path) -> dict[str, tuple[float, float]]:
    """Draws the drives and returns for each the largest errors of position of ICRIK and ICRHK, m."""
    j8 = sidehill.Vehicle.load(CONFIG / "vehicles/j8.yaml")
    drives = {
        "a: rotation, 3.6 deg": rotation(j8),
        "b: figure of eight, 5.3 deg": driven("figure_eight"),
        "c: three zones": driven("paper_3_zones"),
    }
    errors = {}
    axes = plt.subplots(1, 3, figsize=(15, 5), constrained_layout=True)[1]
    for axis, (name, log) in zip(axes, drives.items(), strict=True):
        paths = {"ICRIK": dead_reckoned(log, j8, ""), "ICRHK": dead_reckoned(log, j8, "icrhk_")}
        axis.plot(log["x_m"], log["y_m"], "k", linewidth=3, label="true")
        for (model, path), colour in zip(paths.items(), ("tab:blue", "tab:orange"), strict=True):
            axis.plot(path[0], path[1], color=colour, label=model)
        axis.set(aspect="equal", adjustable="datalim", xlabel="x (m)", ylabel="y (m), uphill", title=name)
        axis.legend()
        errors[name] = tuple(
            float(np.hypot(path[0] - log["x_m"], path[1] - log["y_m"]).max()) for path in paths.values()
        )
    plt.savefig(out / "figure_7.png", dpi=120)
    plt.close()
    return errors


def main(out: Path) -> dict[str, tuple[float, float]]:
    out.mkdir(parents=True, exist_ok=True)
    figure_2(out)
    errors = figure_7(out)
    for name, (icrik, icrhk) in errors.items():
        print(f"{name}: largest error of dead reckoning by ICRIK {icrik:.3f} m, by ICRHK {icrhk:.3f} m")
    return errors


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    main(parser.parse_args().out)
