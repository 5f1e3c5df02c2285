#!/usr/bin/env python3
"""Times solvers on the QPs of the controller: a table and a plot of three sets.

    python3 -m venv target/peers/venv
    target/peers/venv/bin/pip install -r benches/peers/requirements.txt
    target/peers/venv/bin/python benches/peers/peers.py

It records the QPs (`sidehill simulate --record-qps`), lets each solver solve them in their order, cold
and warm, and lets Sidehill's own solver do so too (`examples/solve_qps.rs`), all in one run. Results go to
`target/peers/`: `table.md`, `times.svg`, `times.json`.
"""

import argparse
import concurrent.futures
import gc
import json
import multiprocessing
import os
import pathlib
import platform
import subprocess
import time

# One thread each: a control cycle has one core.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np

import libraries
import solvers
from problems import Recording

ROOT = pathlib.Path(__file__).resolve().parents[2]
OUT = ROOT / "target" / "peers"

#: Of each set: arguments of `sidehill simulate`.
SETS = {
    "calm": ["config/scenarios/figure_eight.yaml"],
    "noisy": ["config/scenarios/figure_eight_10deg.yaml", "--conditions", "realistic", "--seed", "41"],
    "end_of_grip": ["config/scenarios/figure_eight_15deg.yaml", "--conditions", "realistic", "--seed", "42"],
}
SOLVERS = [
    solvers.Clarabel, libraries.Hpipm, solvers.Daqp, solvers.PiqpMultistage, solvers.Piqp, solvers.Osqp,
    solvers.Proxqp, libraries.Qpoases, solvers.Highs, solvers.Ecos, solvers.Scs,
]
#: A solution that violates a row or misses the least cost by more than this counts as a failure.
ACCEPTED = 1e-3
#: Slow solvers get this time for a set, then the QPs that are left are not counted.
PATIENCE_S = 60.0


def cargo(*arguments, check=True):
    subprocess.run(["cargo", "run", "--release", "--quiet", *arguments], cwd=ROOT, check=check)


def record(name):
    """Returns the file of a set, recorded anew where it is missing."""
    path = OUT / f"{name}.npz"
    if not path.exists():
        # A drive that is stopped ends with status 1, and its QPs are recorded.
        cargo("--", "simulate", *SETS[name], "--controller", "icrik-mpc", "--record-qps", str(path), check=False)
    return path


def own_solver(path):
    """Yields the results of Sidehill's solver: label, times in us, points."""
    result = path.with_suffix(".solved.npz")
    cargo("--example", "solve_qps", "--", str(path), str(result))
    with np.load(result) as data:
        for mode in ("active_set", "interior_point"):
            yield f"sidehill {mode}", data[f"{mode}_us"], data[f"{mode}_x"]


def peer(path, kind, warm, patience_s):
    """Returns times in us and points of a peer; None for the point of a failure."""
    recording = Recording(path)
    qps = (recording[i] for i in range(len(recording)))
    solver = kind(recording, warm)
    times, points = [], []
    begin = time.monotonic()
    gc.disable()
    for qp in qps:
        if kind.condensed:
            qp = qp.condensed()
        problem = solver.prepare(qp)
        start = time.perf_counter_ns()
        try:
            x = solver.solve(problem)
        except Exception as error:  # A solver's own exception is its failure.
            x = None
            if not points or points[-1] is not None:
                print(f"    {kind.name}: {error}")
        times.append((time.perf_counter_ns() - start) / 1e3)
        if x is not None and qp.lift is not None:
            x = qp.lift @ x
        points.append(None if x is None else np.asarray(x))
        if time.monotonic() - begin > patience_s:
            break
    gc.enable()
    return np.array(times), points


def in_own_process(*arguments):
    """Returns what `peer` does, in a process of its own: what one library breaks is not another's."""
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(peer, *arguments).result()


def judge(qps, reference, times, points):
    """Returns the row of the table."""
    failures, distances = 0, []
    for qp, best, x in zip(qps, reference, points):
        if x is None or not np.all(np.isfinite(x)):
            failures += 1
            continue
        least = qp.cost(best)
        if qp.violation(x) > ACCEPTED or qp.cost(x) - least > ACCEPTED * (1 + abs(least)):
            failures += 1
            continue
        distances.append(np.abs(x - best).max())
    quantile = lambda share: float(np.quantile(times, share, method="inverted_cdf"))  # noqa: E731
    return {
        "qps": len(times),
        "p50_us": quantile(0.5),
        "p99_us": quantile(0.99),
        "worst_us": float(times.max()),
        "failures": failures,
        "distance_p99": float(np.quantile(distances, 0.99)) if distances else float("nan"),
    }


def run_set(name, patience_s):
    path = record(name)
    recording = Recording(path)
    qps = [recording[i] for i in range(len(recording))]
    rows, times_of = {}, {}
    own = list(own_solver(path))
    with np.load(path.with_suffix(".solved.npz")) as data:
        reference = data["reference_x"]

    def add(label, times, points):
        rows[label], times_of[label] = judge(qps, reference, times, points), times.tolist()
        row = rows[label]
        print(f"  {label:28} p50 {row['p50_us']:9.0f}  p99 {row['p99_us']:9.0f}  failures {row['failures']}")

    print(f"{name}: {len(qps)} QPs of {recording.variables} variables, {recording.equalities} equalities and "
          f"{recording.rows - recording.equalities} inequalities")
    for label, times, points in own:
        add(label, times, points)
    for kind in SOLVERS:
        for warm in (False, True) if kind.can_warm else (False,):
            label = f"{kind.name} {'warm' if warm else 'cold'}"
            try:
                times, points = in_own_process(path, kind, warm, patience_s)
            except (ImportError, OSError) as error:
                print(f"  {label}: not there ({error})")
                continue
            except concurrent.futures.process.BrokenProcessPool:
                print(f"  {label}: crashed")
                continue
            add(label, times, points)
    return rows, times_of


def table(results):
    lines = []
    for name, rows in results.items():
        lines += [
            f"## {name}", "",
            "| solver | p50, us | p99, us | worst, us | failures | farthest from the solution (p99) | QPs |",
            "|---|---|---|---|---|---|---|",
        ]
        for label, row in sorted(rows.items(), key=lambda item: item[1]["p99_us"]):
            lines.append(
                f"| {label} | {row['p50_us']:.0f} | {row['p99_us']:.0f} | {row['worst_us']:.0f} | "
                f"{row['failures']} | {row['distance_p99']:.0e} | {row['qps']} |"
            )
        lines.append("")
    return "\n".join(lines)


def plot(results, times, path):
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(times), 1, figsize=(9, 4.2 * len(times)), squeeze=False)
    for axis, (name, by_solver) in zip(axes[:, 0], times.items()):
        order = sorted(by_solver, key=lambda label: -results[name][label]["p99_us"])
        for place, label in enumerate(order):
            row = results[name][label]
            colour = "tab:blue" if label.startswith("sidehill") else "tab:gray"
            axis.plot([row["p50_us"], row["p99_us"]], [place, place], color=colour, linewidth=5)
            axis.plot(row["worst_us"], place, "|", color=colour, markersize=10)
        axis.set_yticks(range(len(order)), order)
        axis.set_xscale("log")
        axis.set_xlabel("time of a solve, us: p50 to p99, and the worst")
        axis.set_title(name.replace("_", " "))
        axis.grid(axis="x", which="both", alpha=0.3)
    figure.tight_layout()
    figure.savefig(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", dest="sets", action="append", choices=list(SETS), help="only this set")
    parser.add_argument("--patience-s", type=float, default=PATIENCE_S, help="most time of a solver for a set")
    arguments = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    results, times = {}, {}
    for name in arguments.sets or SETS:
        results[name], times[name] = run_set(name, arguments.patience_s)
    text = table(results)
    (OUT / "table.md").write_text(text)
    (OUT / "times.json").write_text(json.dumps({"machine": platform.processor(), "times_us": times}))
    plot(results, times, OUT / "times.svg")
    print(text)


if __name__ == "__main__":
    main()
