#!/usr/bin/env python3
"""Writes the tables of docs/results.md: runs their commands and puts the figures between the markers of the page.

    benches/results.py                        all tables; an hour of CPU time, and another one for those of the engines
    benches/results.py model contact          some of them
    benches/results.py --list                 names, and what each takes
    benches/results.py --program sidehill     an installed program instead of `cargo run --release`

A table stands between `<!-- table: NAME -->` and `<!-- end -->`, with the commit at which it was measured. Only the Python
standard library is needed; the tables `mujoco` and `drake` need the wheel and the engine (see the page).
"""

import argparse
import csv
import json
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/results.md"
CONTROLLERS = ["contact-mpc", "icrik-mpc", "icrhk-mpc", "diffdrive-mpc", "pure-pursuit"]
PROGRAM = ["cargo", "run", "--release", "--quiet", "--"]

EIGHTS = [("5.3 deg", "figure_eight"), ("10 deg", "figure_eight_10deg"), ("15 deg", "figure_eight_15deg")]
SCENARIOS = [
    ("figure_eight (5.3 deg)", "figure_eight"),
    ("figure_eight_10deg", "figure_eight_10deg"),
    ("figure_eight_15deg", "figure_eight_15deg"),
    ("slalom (10 deg)", "slalom"),
    ("start_off_path (8 deg)", "start_off_path"),
    ("paper_3_zones (to 5.3 deg)", "paper_3_zones"),
    ("paper_1_pivot (3.6 deg)", "paper_1_pivot"),
]
SEEDS = range(41, 46)
# Of tables with many rows: the best baseline stands for both.
FOUR = [*CONTROLLERS[:3], "pure-pursuit"]
# Of each row under conditions that are told wrong.
RUNS = 20
TOLD_WRONG = {
    "as told": {},
    "commands 0.3 s late, motors lag by 0.4 s": {
        "drive_train.delay_s": 0.3,
        "drive_train.traction.time_constant_s": 0.4,
        "drive_train.steer.time_constant_s": 0.4,
    },
    "traction reaches 0.3 m/s": {"drive_train.traction.speed_max_m_s": 0.3},
    "steer reaches 0.3 m/s": {"drive_train.steer.speed_max_m_s": 0.3},
    "traction runs at 1.5 of its commands": {"drive_train.traction.gain": 1.5},
    "steer runs at 0.5 of its commands": {"drive_train.steer.gain": 0.5},
    "poses at 1 Hz (10)": {"sensors.pose.timing.rate_hz": 1},
    "no pose for 5 s after each 15 s": {"sensors.pose.timing.gap_s": 5},
    "no pose for 10 s after each 10 s": {"sensors.pose.timing.gap_s": 10},
    "poses 0.5 s late (0.1)": {"sensors.pose.timing.delay_s": 0.5},
    "poses with 5 cm of noise (1)": {"sensors.pose.errors.noise_std_m": 0.05},
    "headings 2 deg off": {"sensors.pose.errors.bias_yaw_deg": 2},
    "roll 2 deg off": {"sensors.attitude.errors.bias_roll_deg": 2},
    "friction of 0.35 to 0.6 (0.5 to 0.9)": {"friction.minimum": 0.35, "friction.maximum": 0.6},
}
# Way of a lap of the figure of eight of 4.8 by 7.8 m.
LAP_M = 25.3
# A vehicle of 300 kg whose motors reach 3 m/s.
FAST = {
    "contact": {
        "vehicle": str(ROOT / "config/vehicles/family/four_large.yaml"),
        "identified": str(ROOT / "config/vehicles/family/four_large_guess.yaml"),
    },
    "speed": {"speed_m_s": 3.0},
    "controller": {
        "limits": {
            "traction": {"speed_m_s": 3.0, "acceleration_m_s2": 1.0, "deceleration_m_s2": 2.0},
            "steer": {"speed_m_s": 1.5, "acceleration_m_s2": 2.0, "deceleration_m_s2": 2.0},
            "tread_speed_m_s": 4.0,
        }
    },
    "drive_train": {"traction": {"time_constant_s": 0.15, "acceleration_max_m_s2": 1.0, "deceleration_max_m_s2": 2.0}},
}


def printed(arguments, program=None, failure_allowed=False):
    """Returns what a command prints; the program exits with 1 where a run was not completed."""
    command = [*(program or PROGRAM), *map(str, arguments)]
    print("+", " ".join(command), file=sys.stderr)
    ended = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if ended.returncode > (1 if failure_allowed else 0):
        sys.exit(f"{command} ended with {ended.returncode}")
    return ended.stdout


def simulated(scenario, arguments, controllers):
    """Returns the runs of a scenario by controller."""
    named = [word for name in controllers for word in ("--controller", name)]
    text = printed(["simulate", scenario, *named, *arguments, "--format", "json"], failure_allowed=True)
    return {run["controller"]: run for run in json.loads(text)["runs"]}


def table(head, rows):
    """Returns a table in Markdown."""
    lines = [f"| {' | '.join(line)} |" for line in [head, *rows]]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


def cells(runs_of, controllers, with_steer=True):
    """Returns median error in cm and steer in m/s of each controller, the least error in bold.

    A run that was not completed counts as worse than all that were.
    """
    shown, errors = [], []
    for name in controllers:
        runs = runs_of[name]
        completed = [run for run in runs if run["completed"]]
        missing = [float("inf")] * (len(runs) - len(completed))
        error = statistics.median([run["cross_track_rms_m"] for run in completed] + missing)
        steer = statistics.median(run["steer_total_variation_m_s"] for run in runs)
        shown_steer = f" ({steer:.1f})" if with_steer else ""
        figure = "-" if error == float("inf") else f"{100 * error:.2f}"
        share = f" [{len(completed)} of {len(runs)}]" if missing else ""
        errors.append(error)
        shown.append((figure, shown_steer + share))
    best = min(errors)
    return [f"**{f}**{rest}" if e == best != float("inf") else f + rest for e, (f, rest) in zip(errors, shown)]


def eights(arguments):
    """The figure of eight on three slopes, one run each."""
    rows = []
    for label, scenario in EIGHTS:
        runs = simulated(f"config/scenarios/{scenario}.yaml", arguments, CONTROLLERS)
        rows.append([label, *cells({name: [run] for name, run in runs.items()}, CONTROLLERS)])
    return table(["slope", *CONTROLLERS], rows)


def of_seeds(scenario, arguments, seeds, controllers):
    """Returns the runs of a scenario with several seeds, by controller."""
    runs_of = {name: [] for name in controllers}
    for seed in seeds:
        for name, run in simulated(scenario, [*arguments, "--seed", seed], controllers).items():
            runs_of[name].append(run)
    return runs_of


def realistic():
    rows = []
    for label, scenario in SCENARIOS:
        file = f"config/scenarios/{scenario}.yaml"
        rows.append([label, *cells(of_seeds(file, ["--conditions", "realistic"], SEEDS, FOUR), FOUR)])
    return table(["scenario", *FOUR], rows)


def routes():
    """Recorded routes."""
    rows = []
    for route in ("path_1_june_26", "path_2_june_26", "spin"):
        path = ["--path", f"config/routes/{route}.gpx"]
        file = "config/scenarios/j8_route.yaml"
        seeds = of_seeds(file, [*path, "--conditions", "realistic"], range(41, 44), FOUR)
        rows.append([f"`{route}.gpx`", *cells(seeds, FOUR)])
    return table(["route", *FOUR], rows)


def results(text, runs, folder):
    """Returns the summary and the rows of a campaign with this text."""
    file, out = pathlib.Path(folder) / "campaign.yaml", pathlib.Path(folder) / "results.csv"
    file.write_text(text)
    summary = json.loads(printed(["campaign", file, "--runs", runs, "--out", out, "--format", "json"]))
    with out.open(newline="") as rows:
        return summary["controllers"], list(csv.DictReader(rows))


def campaign(name, seed, runs, controllers):
    """A campaign with another seed, other controllers and the given number of runs."""
    text = (ROOT / f"config/campaigns/{name}.yaml").read_text()
    text = text.replace("../", f"{ROOT / 'config'}/")
    text = re.sub(r"(?m)^seed: .*$", f"seed: {seed}", text)
    text = re.sub(r"(?m)^controllers: .*$", f"controllers: [{', '.join(controllers)}]", text)
    with tempfile.TemporaryDirectory() as folder:
        summary, _ = results(text, runs, folder)
    rows = []
    for row in summary:
        errors = [row[key] for key in ("median_m", "p95_m", "worst_m")]
        errors = ["-" if error is None else f"{100 * error:.2f}" for error in errors]
        completed = f"{row['completed']} of {row['runs']}"
        rows.append([row["controller"], completed, *errors, f"{row['steer_total_variation_m_s']:.1f}"])
    return table(["controller", "completed", "median", "p95", "worst", "steer, m/s"], rows)


def realistic_with(scenario, true, told=None):
    """Runs of a scenario under realistic conditions by controller, with these keys true and others told, too."""
    keys = {
        "name": "realistic_with",
        "seed": 1000004,
        "runs": RUNS,
        "controllers": FOUR,
        "scenario": str(ROOT / f"config/scenarios/{scenario}.yaml"),
        "conditions": "realistic",
        "with": told or {},
        "draws": [{"key": key, "one_of": [value]} for key, value in true.items()],
    }
    with tempfile.TemporaryDirectory() as folder:
        _, rows = results(json.dumps(keys), RUNS, folder)
    runs_of = {name: [] for name in FOUR}
    for row in rows:
        figures = ("cross_track_rms_m", "steer_total_variation_m_s", "mean_speed_m_s")
        run = {key: float(row[key] or "inf") for key in figures}
        runs_of[row["controller"]].append(run | {"completed": row["completed"] == "true"})
    return runs_of


def told_wrong():
    """Things that the controllers are told wrong, one at a time."""
    rows = [
        [label, *cells(realistic_with("slalom", true), FOUR, with_steer=False)]
        for label, true in TOLD_WRONG.items()
    ]
    return table(["true, not told", *FOUR], rows)


def speeds():
    """Courses at speeds from a crawl to more than the motors reach."""
    rows = []
    for size, asked_m_s in [(1, 0.05), (1, 0.1), (1, 0.4), (1, 2), (5, 1), (5, 2), (5, 3)]:
        course = {"shape": "figure_eight", "half_width_m": 2.4 * size, "half_length_m": 3.9 * size}
        course["period_s"] = LAP_M * size / asked_m_s
        told = {} if size == 1 else FAST
        runs_of = realistic_with("figure_eight_10deg", {"course": course}, told)
        driven = statistics.median(run["mean_speed_m_s"] for run in runs_of["contact-mpc"])
        speed = [f"{asked_m_s:g}", f"{driven:.2f}"]
        rows.append(["J8" if size == 1 else "300 kg", *speed, *cells(runs_of, FOUR, with_steer=False)])
    return table(["vehicle", "asked, m/s", "driven, m/s", *FOUR], rows)


def engine(name):
    """Vehicles in a physics engine, the least error of a row in bold."""
    program = [sys.executable, f"bridge/python/benches/{name}_vehicles.py"]
    named = [word for name in ("J8", "four wheels, 60 kg") for word in ("--vehicle", name)]
    text = printed(["--realistic", 3, *named], program)
    head, *rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("|")]
    for row in rows:
        best = min(range(2, len(row)), key=lambda k: float(row[k].split()[0].replace("-", "inf")))
        row[best] = "**" + row[best].replace(" ", "** ", 1)
    return table(head, rows)


TABLES = {
    "model": (lambda: eights(["--plant", "icrik"]), "seconds"),
    "contact": (lambda: eights(["--plant", "contact"]), "seconds"),
    "realistic": (realistic, "minutes"),
    "routes": (routes, "minutes"),
    "campaign": (lambda: campaign("default", 4242, 1000, FOUR), "ten minutes of CPU time"),
    "told_wrong": (told_wrong, "a minute"),
    "speeds": (speeds, "minutes"),
    "first_day": (lambda: campaign("first_day", 1000005, 1000, FOUR), "ten minutes of CPU time"),
    "vehicles": (lambda: campaign("vehicles", 1000002, 2000, FOUR), "ten minutes of CPU time"),
    "mujoco": (lambda: engine("mujoco"), "minutes; needs the wheel and MuJoCo"),
    "drake": (lambda: engine("drake"), "ten minutes; needs the wheel and Drake"),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tables", nargs="*", metavar="TABLE", help="instead of all")
    parser.add_argument("--program", help="instead of `cargo run --release`")
    parser.add_argument("--list", action="store_true", help="list the tables")
    given = parser.parse_args()
    if given.list:
        for name, (_, takes) in TABLES.items():
            print(f"{name:10} {takes}")
        return
    if unknown := set(given.tables) - set(TABLES):
        parser.error(f"no such table: {', '.join(sorted(unknown))}; see --list")
    if given.program:
        PROGRAM[:] = [given.program]
    commit = printed(["rev-parse", "--short", "HEAD"], ["git"]).strip()
    if printed(["status", "--porcelain", "--untracked-files=no", "--", "*.rs", "*.toml", "config"], ["git"]).strip():
        commit += " with changes"
    for name in given.tables or TABLES:
        made = f"{TABLES[name][0]()}\n\nMeasured at commit {commit}."
        # Read anew each time, so that a table is kept where a later one fails.
        page = PAGE.read_text()
        start, end = f"<!-- table: {name} -->\n", "\n<!-- end -->"
        before, after = page.split(start, 1)
        PAGE.write_text(f"{before}{start}\n{made}\n{end}{after.split(end, 1)[1]}")


if __name__ == "__main__":
    main()
