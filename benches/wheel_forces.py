#!/usr/bin/env python3
"""Compares the friction law of the contact model with measured forces of a wheel in sand: prints tables.

    python3 benches/wheel_forces.py            both wheels
    python3 benches/wheel_forces.py smooth     one of them: smooth or grousers
    python3 benches/wheel_forces.py --sinkage-below 30
    python3 benches/wheel_forces.py --angle-up-to 45

It needs numpy. The data and their axes: plant/tests/data/wheel_forces/README.md. The law is that of `sidehill_plant::contact`
for one wheel that does not turn about the vertical, as drag over load. Other laws stand beside it with about as many
parameters; so do a free polynomial and what the other trials at the same speed and angle say. Each law is fitted to some
trials and predicts those left out: random halves, and all trials of one side-slip angle at a time. Intervals are a bootstrap
over the pairs of speed and angle ("cells"); the fits stay the same in it.
"""

import argparse
import collections
import csv
import pathlib

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[1]
TRIALS = ROOT / "plant/tests/data/wheel_forces/trials.csv"
SPLITS = 20
RESAMPLES = 2000
SEED = 41
#: Of the wheel, without grousers, from the source: radius and width, m.
RADIUS_M, WIDTH_M = 0.058, 0.05


class Trials:
    """Trials of one wheel as arrays; speeds in mm/s, so that all parameters are of the size of one."""

    def __init__(self, rows):
        column = {key: np.array([float(row[key]) for row in rows]) for key in rows[0] if key != "wheel"}
        self.angle_deg = column["side_slip_deg"]
        self.set_mm_s = 1e3 * column["wheel_speed_set_m_s"]
        self.angle = np.radians(self.angle_deg)
        self.wheel = 1e3 * column["wheel_speed_m_s"]
        travel = 1e3 * column["travel_speed_m_s"]
        self.sideways, self.forward = travel * np.sin(self.angle), travel * np.cos(self.angle)
        self.ratio = column["slip"]
        self.load = column["load_n"]
        self.sinkage = column["sinkage_m"]
        self.drag = np.stack([column["drag_sideways_n"], column["drag_forward_n"]]) / self.load
        self.cell = np.unique(np.stack([self.set_mm_s, self.angle_deg]), axis=1, return_inverse=True)[1].ravel()

    def __getitem__(self, chosen):
        part = object.__new__(Trials)
        part.__dict__ = {key: value[..., chosen] for key, value in self.__dict__.items()}
        return part

    def of_cells(self, chosen):
        """The cells of which `chosen` holds."""
        part = self[chosen[self.cell]]
        part.cell = np.unique(part.cell, return_inverse=True)[1]
        return part

    def mean_of_cells(self, values):
        return np.bincount(self.cell, values) / np.bincount(self.cell)

    def with_sinkage(self, sinkage):
        part = object.__new__(Trials)
        part.__dict__ = {**self.__dict__, "sinkage": sinkage}
        return part


def law(trials, mu, share=1.0, scale=1e-6, slip_share=0.0, rolling=0.0, factor=1.0):
    """Drag over load, sideways and forward, of the contact model."""
    wheel = factor * trials.wheel
    slip = trials.forward - wheel
    q = np.sqrt((share * trials.sideways) ** 2 + slip**2 + scale**2 + (slip_share * wheel) ** 2)
    resistance = rolling * trials.forward / np.hypot(trials.forward, scale)
    return np.stack([mu * share**2 * trials.sideways / q, mu * slip / q + resistance])


def no_ellipse(trials, mu, share, scale, slip_share, rolling):
    """The same with forces of the two directions that know nothing of each other."""
    give = scale**2 + (slip_share * trials.wheel) ** 2
    slip = trials.forward - trials.wheel
    resistance = rolling * trials.forward / np.hypot(trials.forward, scale)
    sideways = mu * share * trials.sideways / np.sqrt(trials.sideways**2 + give)
    return np.stack([sideways, mu * slip / np.sqrt(slip**2 + give) + resistance])


def bulldozed(trials):
    """Depth squared times the width that the sunk wheel shows the sand, along the travel, over load, in m^3/N."""
    chord = 2 * np.sqrt(np.maximum(2 * RADIUS_M * trials.sinkage - trials.sinkage**2, 0.0))
    chord = np.where(trials.sinkage > RADIUS_M, 2 * RADIUS_M, chord)
    width = WIDTH_M * np.cos(trials.angle) + chord * np.sin(trials.angle)
    push = trials.sinkage**2 * width / trials.load
    return np.stack([push * np.sin(trials.angle), push * np.cos(trials.angle)])


class Formula:
    """A law with positive parameters, fitted by the method of Levenberg and Marquardt in their logarithms.

    `limits` narrows the range of named parameters; `bulldozing` adds a force of `kn_m3` times the pushed sand.
    """

    def __init__(self, function, starts, limits=None, bulldozing=False):
        starts = {**starts, "kn_m3": 20.0} if bulldozing else starts
        self.function, self.names = function, list(starts)
        self.starts = np.log(list(starts.values()))
        ranges = [(limits or {}).get(name, ANYTHING) for name in self.names]
        self.low, self.high = np.log(np.array(ranges, dtype=float).reshape(-1, 2).T)

    def values(self, trials, logs):
        values = dict(zip(self.names, np.exp(logs)))
        push = 1e3 * values.pop("kn_m3", 0.0)
        return self.function(trials, **values) + push * bulldozed(trials)

    def fit(self, trials):
        found = [self.descend(trials, self.starts + shift) for shift in (0.0, 0.7, -0.7)]
        return min(found, key=lambda pair: pair[0])[1]

    def descend(self, trials, logs):
        def error(at):
            return (self.values(trials, at) - trials.drag).ravel()

        logs = np.clip(logs, self.low, self.high)
        damping, here = 1e-2, error(logs)
        for _ in range(200):
            steps = 1e-6 * np.eye(len(logs))
            slopes = np.stack([(error(logs + step) - here) / 1e-6 for step in steps], axis=1)
            downhill = -slopes.T @ here
            # Parameters at a limit that would leave it stay there.
            free = ~((logs <= self.low) & (downhill < 0) | (logs >= self.high) & (downhill > 0))
            if not free.any():
                break
            normal = slopes[:, free].T @ slopes[:, free]
            damped = normal + damping * (np.diag(np.diag(normal)) + 1e-9 * np.eye(len(normal)))
            shift = np.zeros(len(logs))
            shift[free] = np.clip(np.linalg.solve(damped, downhill[free]), -1.0, 1.0)
            there = np.clip(logs + shift, self.low, self.high)
            ahead = error(there)
            gain = here @ here - ahead @ ahead
            if gain > 0.0:
                logs, here, damping = there, ahead, damping / 3
                if gain < 1e-10 * (here @ here):
                    break
            else:
                damping *= 4
                if damping > 1e10:
                    break
        return here @ here, logs

    def predict(self, fitted, trials):
        return self.values(trials, fitted)

    def parameters(self, fitted):
        return ", ".join(f"{name} {value:.3g}" for name, value in zip(self.names, np.exp(fitted)))


class Polynomial:
    """A free polynomial of slip ratio and angle for each direction."""

    def __init__(self, degree):
        self.powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]

    def terms(self, trials):
        return np.stack([trials.ratio**i * trials.angle**j for i, j in self.powers], axis=1)

    def fit(self, trials, measured=None):
        return np.linalg.lstsq(self.terms(trials), trials.drag.T if measured is None else measured, rcond=None)[0]

    def predict(self, fitted, trials):
        return (self.terms(trials) @ fitted).T


class SinkageForetold:
    """A law with bulldozing that is not told the sinkage of the trials left out: a cubic of slip and angle foretells it."""

    def __init__(self, formula):
        self.formula, self.cubic = formula, Polynomial(3)

    def fit(self, trials):
        return self.formula.fit(trials), self.cubic.fit(trials, trials.sinkage)

    def predict(self, fitted, trials):
        sinkage = np.maximum(self.cubic.predict(fitted[1], trials), 0.0)
        return self.formula.predict(fitted[0], trials.with_sinkage(sinkage))


ANYTHING = (1e-4, 1e3)
START = {"mu": 1.0, "share": 1.0, "scale": 3.0, "slip_share": 0.3, "rolling": 0.3}
#: Ranges of a vehicle file (docs/configuration.md); the scale in mm/s.
ALLOWED = {"mu": (0.05, 2), "share": (0.1, 2), "scale": (0.1, 1e3), "slip_share": (1e-4, 1), "rolling": (1e-4, 0.5)}


def without(name):
    return {key: START[key] for key in START if key != name}


def nothing(trials):
    return np.zeros_like(trials.drag)


LAW = "law"
MODELS = {
    LAW: Formula(law, START),
    "law within the ranges of a vehicle file": Formula(law, START, ALLOWED),
    "(a) Coulomb, isotropic": Formula(law, {"mu": 1.0}),
    "(b) law, isotropic": Formula(law, without("share")),
    "(b') law, no rolling resistance": Formula(law, without("rolling")),
    "(c) no friction ellipse": Formula(no_ellipse, START),
    "law, factor of wheel speed": Formula(law, {**START, "factor": 1.0}),
    "(d) quadratic": Polynomial(2),
    "(d') cubic": Polynomial(3),
    "bulldozing alone": Formula(nothing, {}, bulldozing=True),
    "(a) and bulldozing": Formula(law, {"mu": 1.0}, bulldozing=True),
    "(b) and bulldozing": Formula(law, without("share"), bulldozing=True),
    "(b') and bulldozing": Formula(law, without("rolling"), bulldozing=True),
    "(c) and bulldozing": Formula(no_ellipse, START, bulldozing=True),
    "law without slip share, and bulldozing": Formula(law, without("slip_share"), bulldozing=True),
    "law within the ranges, and bulldozing": Formula(law, START, ALLOWED, bulldozing=True),
    "law and bulldozing": Formula(law, START, bulldozing=True),
    "- its sinkage foretold": SinkageForetold(Formula(law, START, bulldozing=True)),
    "- its sinkage shuffled within angles": Formula(law, START, bulldozing=True),
    "- its sinkage shuffled": Formula(law, START, bulldozing=True),
}


def halves(count, random):
    """Yields the trials that are left out: both halves of each split."""
    for _ in range(SPLITS):
        chosen = random.permutation(count) < count // 2
        yield chosen
        yield ~chosen


def squares(model, trials, folds):
    """Mean squared error of each held-out force over load, by direction and trial."""
    total, times = np.zeros_like(trials.drag), np.zeros(len(trials.load))
    for left_out in folds:
        miss = model.predict(model.fit(trials[~left_out]), trials[left_out]) - trials[left_out].drag
        total[:, left_out] += miss**2
        times[left_out] += 1
    return total / times


def squares_of_cells(trials):
    """The same where the mean of the other trials at the same speed and angle predicts each."""
    miss = np.zeros_like(trials.drag)
    for i, cell in enumerate(trials.cell):
        others = (trials.cell == cell) & (np.arange(len(trials.cell)) != i)
        miss[:, i] = trials.drag[:, i] - trials.drag[:, others].mean(axis=1)
    return miss**2


def deviations(trials):
    return (trials.drag - trials.drag.mean(axis=1, keepdims=True)) ** 2


def explained(errors, spread, weights):
    """R^2 of both directions together, for one set of weights of the trials or many."""
    return 1 - (errors.sum(axis=0) @ weights) / (spread.sum(axis=0) @ weights)


def interval(values):
    low, high = np.percentile(values, [2.5, 97.5])
    return f"{low:.2f} to {high:.2f}"


def resampled(cell, random):
    """Weights of the trials in each resample of the cells, one resample a column."""
    count = cell.max() + 1
    return random.multinomial(count, np.full(count, 1 / count), size=RESAMPLES).T[cell]


def load_exponent(trials, random):
    """Growth of force with load among the trials of a cell, as an exponent: the law says 1."""

    def slope(log_force, log_load, weights):
        return (log_force * log_load) @ weights / (log_load**2 @ weights)

    def within(values):
        return values - trials.mean_of_cells(values)[trials.cell]

    log_load = within(np.log(trials.load))
    log_force = within(np.log(np.hypot(*(trials.drag * trials.load))))
    weights = resampled(trials.cell, random)
    value = slope(log_force, log_load, np.ones(len(log_load)))
    return f"{value:.2f} ({interval(slope(log_force, log_load, weights))}), load within a cell +-{100 * log_load.std():.0f} %"


def print_residuals(model, trials, predicted):
    """Measured minus fitted, by wheel speed and angle."""
    angles = np.unique(trials.angle_deg)
    for name, measured, miss in zip(("sideways", "forward"), trials.drag, trials.drag - predicted):
        print(f"\nDrag {name} over load, measured minus {model} (measured in brackets), by wheel speed and angle:\n")
        print("| mm/s | " + " | ".join(f"{angle:.0f} deg" for angle in angles) + " |")
        print("|---" * (len(angles) + 1) + "|")
        for speed in np.unique(trials.set_mm_s):
            row = [(trials.set_mm_s == speed) & (trials.angle_deg == angle) for angle in angles]
            cells = [f"{miss[at].mean():+.2f} ({measured[at].mean():.2f})" if at.any() else "" for at in row]
            print(f"| {speed:.0f} | " + " | ".join(cells) + " |")


def told_sinkage(trials, random):
    """Trials with the sinkage of another one, by model: of any, and of one at the same angle."""
    within = trials.sinkage.copy()
    for angle in np.unique(trials.angle_deg):
        within[trials.angle_deg == angle] = random.permutation(within[trials.angle_deg == angle])
    return {
        "- its sinkage shuffled within angles": trials.with_sinkage(within),
        "- its sinkage shuffled": trials.with_sinkage(random.permutation(trials.sinkage)),
    }


def report(wheel, trials):
    random = np.random.default_rng(SEED)
    spread = deviations(trials)
    ones = np.ones(len(trials.load))
    weights = resampled(trials.cell, random)
    told = told_sinkage(trials, random)
    by_half = list(halves(len(trials.load), random))
    by_angle = [trials.angle_deg == angle for angle in np.unique(trials.angle_deg)]
    print(f"\n## {wheel}\n")
    print(
        f"{len(trials.load)} trials, load {trials.load.min():.0f} to {trials.load.max():.0f} N, "
        f"sinkage {1e3 * trials.sinkage.min():.0f} to {1e3 * trials.sinkage.max():.0f} mm; "
        f"standard deviation of drag over load {trials.drag[0].std():.2f} sideways, {trials.drag[1].std():.2f} forward\n"
    )
    heads = ["model", "RMS sideways, forward", "R^2 sideways, forward"]
    heads += ["R^2, halves", "less law", "R^2, angle left out", "less law"]
    print("| " + " | ".join(heads) + " |")
    print("|---" * len(heads) + "|")
    laws = {}
    for name, model in MODELS.items():
        errors = [squares(model, told.get(name, trials), folds) for folds in (by_half, by_angle)]
        laws.setdefault(LAW, errors)
        cells = []
        for miss, base in zip(errors, laws[LAW]):
            sampled = explained(miss, spread, weights)
            cells.append(f"{explained(miss, spread, ones):.2f} ({interval(sampled)})")
            cells.append("" if name == LAW else interval(sampled - explained(base, spread, weights)))
        print(f"| {name} | {directions(errors[0], spread)} | " + " | ".join(cells) + " |")
    repeats = squares_of_cells(trials)
    value = f"{explained(repeats, spread, ones):.2f} ({interval(explained(repeats, spread, weights))})"
    print(f"| other trials of the cell | {directions(repeats, spread)} | {value} | | | |")

    print("\nFitted to all trials (scale in mm/s):\n")
    for name, model in MODELS.items():
        if isinstance(model, Formula) and name not in told:
            print(f"- {name}: {model.parameters(model.fit(trials))}")
    print(f"\nForce grows with load to the power of {load_exponent(trials, random)}")
    for name in (LAW, "law and bulldozing"):
        model = MODELS[name]
        print_residuals(name, trials, model.predict(model.fit(trials), trials))


def directions(errors, spread):
    rms, share = np.sqrt(errors.mean(axis=1)), 1 - errors.sum(axis=1) / spread.sum(axis=1)
    return f"{rms[0]:.2f}, {rms[1]:.2f} | {share[0]:.2f}, {share[1]:.2f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheels", nargs="*", help="smooth, grousers; both by default")
    parser.add_argument("--sinkage-below", type=float, metavar="MM", help="only cells where the wheel sinks less on average")
    parser.add_argument("--angle-up-to", type=float, metavar="DEG", help="only these side-slip angles")
    arguments = parser.parse_args()
    rows = collections.defaultdict(list)
    with TRIALS.open() as file:
        for row in csv.DictReader(file):
            rows[row["wheel"]].append(row)
    for wheel in arguments.wheels or rows:
        if wheel not in rows:
            parser.error(f"no wheel {wheel}, there are {', '.join(rows)}")
        trials = Trials(rows[wheel])
        if arguments.sinkage_below is not None:
            trials = trials.of_cells(trials.mean_of_cells(trials.sinkage) < 1e-3 * arguments.sinkage_below)
        if arguments.angle_up_to is not None:
            trials = trials.of_cells(trials.mean_of_cells(trials.angle_deg) <= arguments.angle_up_to)
        report(wheel, trials)


if __name__ == "__main__":
    main()
