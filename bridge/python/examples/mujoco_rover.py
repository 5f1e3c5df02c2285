"""A rover in MuJoCo: identified from its logs, then followed in closed loop on a slope, with a picture.

    python bridge/python/examples/mujoco_rover.py --out out

The controller knows the rover only by what `sidehill.identify` finds in a log on level ground and one on a slope of 6
deg; the course is on another slope, 10 deg. Without a display the picture is drawn by EGL, and where that is missing too
there is none, which it says.
"""

# MuJoCo's classes are compiled and have no stubs.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import argparse
import ctypes.util
import os
import sys
from pathlib import Path
from typing import Any

import sidehill

if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    # MuJoCo looks for this when it is imported.
    os.environ.setdefault("MUJOCO_GL", "egl" if ctypes.util.find_library("EGL") else "disable")

from rover import AXLES_M, TRACK_HALF_M, MujocoRover

SLOPE_DEG = 10


def identified() -> sidehill.Identification:
    """Returns what two drives tell of the rover."""
    guess = sidehill.Vehicle.from_dict({
        "name": "mujoco-rover",
        "x_icr_left_m": -2 * TRACK_HALF_M, "x_icr_right_m": 2 * TRACK_HALF_M, "y_icr_m": 0.0,
        "lambda_1_s_per_rad": 1.0, "lambda_2_s_per_rad": 1.0, "speed_max_m_s": 0.6,
        "base_half_width_m": TRACK_HALF_M, "base_half_length_m": max(AXLES_M),
        "correction_left": 1.0, "correction_right": 1.0,
    })  # fmt: skip
    level, slope = MujocoRover(0), MujocoRover(6)
    level.reset((0, 0, 0, 0), (0, 0))
    slope.reset((0, 0, 0, 0), (0, 0.1047))
    turns = [(8.0, 0.3, 0.3), (10.0, 0.1, 0.4), (10.0, 0.4, 0.15), (8.0, -0.2, -0.35), (10.0, -0.25, 0.25),
             (8.0, 0.2, -0.2), (8.0, 0.45, 0.2)]  # fmt: skip
    spins = [(20.0, -0.25, 0.25), (20.0, 0.2, -0.2), (15.0, 0.1, 0.4), (15.0, 0.4, 0.1)]
    return sidehill.identify(level=[level.drive(turns)], slope=[slope.drive(spins)], vehicle=guess, segment_s=4)


def scenario(vehicle: sidehill.Vehicle) -> sidehill.Scenario:
    """Returns a figure of eight for the rover; where it starts is all the plant takes from it."""
    return sidehill.Scenario(
        name="mujoco_eight",
        vehicle=vehicle,
        terrain={"kind": "plane", "slope_deg": SLOPE_DEG, "uphill_heading_deg": 0},
        course={"shape": "figure_eight", "half_width_m": 1.2, "half_length_m": 2.0, "period_s": 50},
        controllers=["icrik-mpc", "icrhk-mpc"],
        step_s=0.01,
    )


def picture(rover: MujocoRover, runs: list[sidehill.Run], path: Path) -> None:
    """Writes the scene at the end of the last run, with the reference and the tracks drawn on the ground."""
    if os.environ.get("MUJOCO_GL") == "disable":
        print("no picture: there is neither a display nor EGL (libEGL; on Debian and Ubuntu the package libegl1)")
        return
    import matplotlib.image
    import mujoco
    import numpy as np

    renderer = mujoco.Renderer(rover.model, 720, 1280)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance, camera.azimuth, camera.elevation = (0, 0, 0), 6.5, 60, -35
    renderer.update_scene(rover.data, camera)
    lines: list[tuple[dict[str, Any], str, tuple[float, ...]]] = [(runs[0].log, "reference_", (1, 1, 1, 1))]
    lines += [(run.log, "", colour) for run, colour in zip(runs, [(0.1, 0.4, 0.9, 1), (0.9, 0.4, 0.1, 1)], strict=True)]
    rise = np.tan(rover.slope_rad)
    for height, (log, prefix, colour) in enumerate(lines):
        points = np.column_stack([log[f"{prefix}x_m"], log[f"{prefix}y_m"]])[::4]
        for a, b in zip(points[:-1], points[1:], strict=True):
            geom = renderer.scene.geoms[renderer.scene.ngeom]
            mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.zeros(9), np.array(colour))
            ends = [np.array([*point, point[1] * rise + 0.01 + 0.004 * height]) for point in (a, b)]
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.012, *ends)
            renderer.scene.ngeom += 1
    matplotlib.image.imsave(path, renderer.render())
    renderer.close()


def main(out: Path, render: bool = True) -> sidehill.SimulationResult:
    out.mkdir(parents=True, exist_ok=True)
    vehicle = identified()
    for stage in filter(None, (vehicle.level, vehicle.slope)):
        print({key: round(found["value"], 3) for key, found in stage["estimates"].items()})
    rover = MujocoRover(SLOPE_DEG)
    result = sidehill.simulate(scenario(vehicle), plant=rover)
    for run in result.metrics["runs"]:
        print(
            f"{run['controller']}: cross-track RMS {100 * run['cross_track_rms_m']:.2f} cm, largest "
            f"{100 * run['cross_track_max_m']:.2f} cm, steer total variation {run['steer_total_variation_m_s']:.1f} m/s"
        )
    if render:
        picture(rover, result.runs, out / "mujoco_rover.png")
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    main(parser.parse_args().out)
