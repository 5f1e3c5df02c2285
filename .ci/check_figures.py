#!/usr/bin/env python3
"""Checks the figures of the main job: `.ci/check_figures.py FOLDER`.

FOLDER holds what `sidehill simulate --format json` printed, a file for each scenario or route.
"""

import json
import pathlib
import sys

# Largest cross-track RMS of icrik-mpc on the figure of eight, m, by scenario.
FIGURE_EIGHTS = {
    "figure_eight": 0.0010,
    "figure_eight_10deg": 0.0020,
    "figure_eight_15deg": 0.0035,
}
# Largest share of icrhk-mpc's cross-track RMS, and of its steer total variation.
LARGEST_ERROR_RATIO = 0.1
LARGEST_STEER_RATIO = 1.1
# Largest cross-track RMS on a recorded route, m.
ROUTES = {"path_1_june_26": 0.03, "path_2_june_26": 0.03, "spin": 0.03}


def runs_of(folder, name):
    """Returns the runs of a file by their controllers."""
    runs = json.loads((folder / f"{name}.json").read_text())["runs"]
    return {run["controller"]: run for run in runs}


def main(folder):
    failed = []

    def check(what, value, limit):
        verdict = "ok" if value <= limit else "TOO LARGE"
        print(f"{what:58} {value:9.4g}   at most {limit:<7g} {verdict}")
        if not value <= limit:
            failed.append(what)

    for name, limit in FIGURE_EIGHTS.items():
        runs = runs_of(folder, name)
        own, flat = runs["icrik-mpc"], runs["icrhk-mpc"]
        rms, steer = "cross_track_rms_m", "steer_total_variation_m_s"
        check(f"{name}: cross-track RMS, m", own[rms], limit)
        check(f"{name}: cross-track RMS / icrhk-mpc's", own[rms] / flat[rms], LARGEST_ERROR_RATIO)
        check(f"{name}: steer variation / icrhk-mpc's", own[steer] / flat[steer], LARGEST_STEER_RATIO)
        check(f"{name}: runs not completed", sum(not run["completed"] for run in runs.values()), 0)
        for kind in ("constraint_violations", "fallbacks"):
            check(f"{name}: {kind} of icrik-mpc", own[kind], 0)
    for name, limit in ROUTES.items():
        run = runs_of(folder, name)["icrik-mpc"]
        check(f"{name}: cross-track RMS, m", run["cross_track_rms_m"], limit)
        check(f"{name}: runs not completed", int(not run["completed"]), 0)
    if failed:
        print("failed:", "; ".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
