"""What a step from Python costs above the cycle in Rust.

    python bridge/python/benches/step_cost.py [--program target/release/sidehill]

The controller drives the simulated figure of eight from Python. Each step is timed from outside with perf_counter_ns; the
controller's own time is what the decision tells (`cycle_us`, the same clock and the same place as the cycle of
`sidehill simulate`). Beside them stand the percentiles of `sidehill.simulate` (the same build, no Python in the loop)
and, where a program is given, those that it prints. `--max-us` makes it a check: the exit status is 1 where the median
is above.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import sidehill

CONFIG = Path(__file__).resolve().parents[3] / "config"
SCENARIO = CONFIG / "scenarios/figure_eight.yaml"


def drive(kind: str, read: bool) -> tuple[list[float], list[float]]:
    """Returns the times of all steps from outside and within, us; `read` also reads all of each decision."""
    scenario = sidehill.Scenario.load(SCENARIO)
    simulation, controller = sidehill.Simulation(scenario), sidehill.Controller(scenario, kind)
    dt_s = scenario.period_s
    outside, within = [], []
    while True:
        time_s, pose = simulation.time_s, simulation.pose
        treads, attitude = simulation.tread_speeds_m_s, simulation.attitude_rad
        begin = time.perf_counter_ns()
        decision = controller.step(time_s, tread_speeds_m_s=treads, attitude_rad=attitude, pose=(time_s, *pose))
        if read:
            _ = decision.plan, decision.estimate, decision.cross_track_m, decision.reason
        traction, steer = decision.drive_traction_m_s, decision.drive_steer_m_s
        end = time.perf_counter_ns()
        outside.append((end - begin) / 1e3)
        within.append(decision.cycle_us)
        if decision.finished:
            return outside, within
        simulation.step(traction - steer, traction + steer, dt_s)


def quantiles(values: Iterable[float]) -> dict[str, float]:
    ordered = np.sort(list(values))
    return {name: float(ordered[int(np.ceil(share * len(ordered))) - 1]) for name, share in
            (("p50", 0.5), ("p99", 0.99), ("p999", 0.999), ("max", 1.0))}  # fmt: skip


def main(kinds: list[str], rounds: int, program: Path | None) -> dict[str, float]:
    """Prints the table and returns the median of what a step costs above its cycle, us, by controller."""
    medians = {}
    print(f"{'us':44}" + "".join(f"{name:>9}" for name in ("p50", "p99", "p999", "max")))

    def row(name: str, figures: dict[str, float]) -> None:
        print(f"{name:44}" + "".join(f"{figures[key]:9.1f}" for key in ("p50", "p99", "p999", "max")))

    for kind in kinds:
        if program is not None:
            command = [program, "simulate", SCENARIO, "--controller", kind, "--format", "json"]
            printed = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
            row(f"{kind}: the program's cycle", printed["runs"][0]["cycle_us"])
        result = sidehill.simulate(sidehill.Scenario.load(SCENARIO), controllers=kind)
        row(f"{kind}: sidehill.simulate's cycle", result.metrics["runs"][0]["cycle_us"])
        for read in (False, True):
            outside, within = [], []
            for _ in range(rounds):
                for all_of, new in zip((outside, within), drive(kind, read), strict=True):
                    all_of += new
            what = "step, with all of the decision read" if read else "step"
            row(f"{kind}: {what}", quantiles(outside))
            above = quantiles(a - b for a, b in zip(outside, within, strict=True))
            row(f"{kind}: {what}, less its cycle", above)
            medians.setdefault(kind, above["p50"])
    return medians


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--controllers", nargs="+", default=["icrik-mpc", "contact-mpc", "pure-pursuit"])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--program", type=Path)
    parser.add_argument("--max-us", type=float, default=float("inf"))
    given = parser.parse_args()
    found = main(given.controllers, given.rounds, given.program)
    sys.exit(any(median > given.max_us for median in found.values()))
