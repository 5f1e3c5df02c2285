"""Rows of the benchmark `sidehill.benchmark`: Sidehill's controllers, and two policies that learned from the observation.

    python bridge/python/benches/path_tracking.py                       the table, as in path_tracking.md
    python bridge/python/benches/path_tracking.py --train clone|search  learns one anew and writes its weights

The policies are in path_tracking/, in float32. `clone` is a network of two hidden layers that imitates `icrik-mpc`: it
drives itself, and learns what the controller would have done there (DAgger, Ross et al. 2011). `search` is a linear policy
found by augmented random search (Mania et al. 2018), which sees nothing but rewards. Both train on seeds below 1,000,000.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import sidehill
from sidehill import benchmark
from sidehill.gym import Baseline, PathTracking, VectorPathTracking

WEIGHTS = Path(__file__).resolve().with_suffix("")
CONTROLLERS: tuple[sidehill.Kind, ...] = ("icrik-mpc", "contact-mpc", "icrhk-mpc", "diffdrive-mpc", "pure-pursuit")
STANDS = 0.04
"""Actions below this are none."""
Floats = npt.NDArray[np.float64]


def halted(actions: Floats) -> Floats:
    """Returns 0 for actions that are about 0: an episode ends where the vehicle stands, and nothing learned is exactly 0."""
    return np.where(abs(actions).max(-1, keepdims=True) < STANDS, 0.0, actions)


class Network:
    """A policy: layers with tanh between them on observations in units of their standard deviation; linear with one."""

    def __init__(self, layers: list[tuple[Floats, Floats]], mean: Floats, deviation: Floats) -> None:
        self.layers, self.mean, self.deviation = layers, mean, deviation

    def values(self, observations: npt.NDArray[np.floating]) -> list[Floats]:
        """Returns the input of each layer, and the actions, shape (n, 2), at last."""
        values = [(np.asarray(observations, np.float64) - self.mean) / self.deviation]
        for index, (weights, bias) in enumerate(self.layers):
            out = values[-1] @ weights + bias
            values.append(out if index == len(self.layers) - 1 else np.tanh(out))
        return values

    def __call__(self, observations: npt.NDArray[np.floating]) -> Floats:
        return halted(self.values(observations)[-1])

    def save(self, name: str) -> None:
        WEIGHTS.mkdir(exist_ok=True)
        arrays = {f"layer_{i}_{part}": a for i, layer in enumerate(self.layers) for part, a in zip("wb", layer, strict=True)}
        arrays |= {"mean": self.mean, "deviation": self.deviation}
        arrays_32: dict[str, Any] = {key: array.astype(np.float32) for key, array in arrays.items()}
        np.savez_compressed(WEIGHTS / f"{name}.npz", **arrays_32)

    @staticmethod
    def load(name: str) -> Network:
        with np.load(WEIGHTS / f"{name}.npz") as file:
            arrays = {key: file[key].astype(np.float64) for key in file.files}
        count = sum(key.endswith("_w") for key in arrays)
        layers = [(arrays[f"layer_{i}_w"], arrays[f"layer_{i}_b"]) for i in range(count)]
        return Network(layers, arrays["mean"], arrays["deviation"])


def clone(rounds: int = 12, episodes: int = 60, hidden: int = 96, epochs: int = 30) -> Network:
    """Returns a network that imitates `icrik-mpc`; its own drives after the first round are the next round's data."""
    random = np.random.default_rng(1)
    env = PathTracking(benchmark.scenario)
    seen: list[Floats] = []
    told: list[Floats] = []
    network: Network | None = None
    seed = 0
    for index in range(rounds):
        finished = 0
        for _ in range(episodes):
            observation, _ = env.reset(seed=seed)
            seed += 1
            teacher = Baseline(env, "icrik-mpc")
            over = False
            while not over:
                action = teacher(observation)
                seen.append(observation.astype(np.float64))
                told.append(action.astype(np.float64))
                # Pushed now and then, or the teacher's drives show nothing but the path.
                drives = action if network is None else network(observation)
                if network is None and random.random() < 0.1:
                    drives = drives + random.normal(0, 0.2, 2)
                observation, _, terminated, truncated, info = env.step(np.clip(drives, -1, 1))
                over = terminated or truncated
            finished += info["finished"]
        x, y = np.array(seen), np.array(told)
        if network is None:
            mean, deviation = x.mean(0), x.std(0) + 1e-6
            sizes = [x.shape[1], hidden, hidden, 2]
            layers = [
                (random.normal(0, 1 / np.sqrt(a), (a, b)), np.zeros(b)) for a, b in zip(sizes[:-1], sizes[1:], strict=True)
            ]
            network = Network(layers, mean, deviation)
        loss = _fitted(network, x, y, epochs, random)
        print(f"round {index}: {finished} of {episodes} finished, {len(x)} steps, RMS {np.sqrt(loss):.4f}", flush=True)
    assert network is not None
    return network


def _fitted(network: Network, x: Floats, y: Floats, epochs: int, random: np.random.Generator) -> float:
    """Fits the layers by Adam to the least mean squared error, and returns it."""
    parameters = [array for layer in network.layers for array in layer]
    firsts, seconds = [np.zeros_like(p) for p in parameters], [np.zeros_like(p) for p in parameters]
    step, loss = 0, 0.0
    batch = 256
    count = epochs * len(x) // batch
    while step < count:
        chosen = random.integers(len(x), size=batch)
        values = network.values(x[chosen])
        error = values[-1] - y[chosen]
        loss = 0.99 * loss + 0.01 * float((error**2).mean()) if step else float((error**2).mean())
        gradient = 2 * error / error.size
        gradients: list[Floats] = []
        for index in reversed(range(len(network.layers))):
            weights, _ = network.layers[index]
            gradients = [values[index].T @ gradient, gradient.sum(0), *gradients]
            gradient = (gradient @ weights.T) * (1 - values[index] ** 2)
        step += 1
        rate = 2e-3 * (1 - step / count) + 1e-5
        for p, g, first, second in zip(parameters, gradients, firsts, seconds, strict=True):
            first += 0.1 * (g - first)
            second += 0.001 * (g * g - second)
            p -= rate * (first / (1 - 0.9**step)) / (np.sqrt(second / (1 - 0.999**step)) + 1e-8)
    return loss


def search(iterations: int = 300, directions: int = 24, best: int = 16, spread: float = 0.05, rate: float = 0.1) -> Network:
    """Returns a linear policy by augmented random search: the mean of the last third of its steps along what was rewarded."""
    random = np.random.default_rng(2)
    envs = VectorPathTracking(benchmark.scenario, num_envs=2 * directions)
    features = envs.single_observation_space.shape
    assert features is not None
    weights = np.zeros((features[0] + 1, 2))
    total, kept = np.zeros_like(weights), iterations // 3
    count, mean, squares = 1e-3, np.zeros(features[0]), np.zeros(features[0])
    for iteration in range(iterations):
        deviation = np.sqrt(squares / count) + 1e-2
        offsets = random.normal(size=(directions, *weights.shape))
        tried = np.concatenate([weights + spread * offsets, weights - spread * offsets])
        seeds = [iteration * directions + i for i in range(directions)] * 2
        observations, _ = envs.reset(seed=list(seeds))
        returns, alive = np.zeros(2 * directions), np.ones(2 * directions, np.bool_)
        # Short drives at first: one that fails begins anew, which takes longer than it drove.
        for _ in range(min(100 + 4 * iteration, 1100)):
            scaled = (observations - mean) / deviation
            actions = np.einsum("ni,nij->nj", scaled, tried[:, :-1]) + tried[:, -1]
            observations, rewards, terminated, truncated, infos = envs.step(np.clip(halted(actions), -1, 1))
            returns += alive * np.maximum(rewards, -10)
            new = observations[alive].astype(np.float64)
            count += len(new)
            change = new - mean
            mean = mean + change.sum(0) / count
            squares = squares + (change * (new - mean)).sum(0)
            alive &= ~(terminated | truncated)
            if not alive.any():
                break
        ahead, back = returns[:directions], returns[directions:]
        chosen = np.argsort(-np.maximum(ahead, back))[:best]
        scale = np.concatenate([ahead[chosen], back[chosen]]).std() + 1e-6
        weights = weights + rate / (best * scale) * np.einsum("d,dij->ij", (ahead - back)[chosen], offsets[chosen])
        if iteration >= iterations - kept:
            total += weights
        if iteration % 10 == 0:
            print(f"iteration {iteration}: mean return {returns.mean():.1f}, best {returns.max():.1f}", flush=True)
    weights = total / kept
    return Network([(weights[:-1], weights[-1])], mean, np.sqrt(squares / count) + 1e-2)


def controller(kind: sidehill.Kind) -> benchmark.Policy:
    return lambda env: Baseline(env, kind)


def learned(name: str) -> benchmark.Policy:
    network = Network.load(name)
    return lambda env: network


def rows() -> dict[str, benchmark.Policy]:
    """Returns the table's policies by name."""
    controllers = {f"`{kind}`": controller(kind) for kind in CONTROLLERS}
    return controllers | {f"`{name}`, learned": learned(name) for name in ("clone", "search")}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--train", choices=["clone", "search"], help="learn one anew and write its weights")
    train = parser.parse_args().train
    begun_s = time.monotonic()
    if train is not None:
        network = clone() if train == "clone" else search()
        network.save(train)
        print(f"{train}: {time.monotonic() - begun_s:.0f} s")
        return
    print("| policy | sees | finished | RMS, median cm | RMS, 95 % cm | steer variation m/s | reward |\n|---|---|---|---|---|---|---|")
    for name, policy in rows().items():
        score = benchmark.score(policy)
        sees = "observation" if name.endswith("learned") else "state, rover"
        median_m, worse_m = np.quantile(score.cross_track_rms_m, [0.5, 0.95], method="higher")
        print(
            f"| {name} | {sees} | {score.finished.sum()} of {len(score.finished)} | {100 * median_m:.2f} | {100 * worse_m:.2f} | "
            f"{np.mean(score.steer_variation_m_s):.1f} | {np.mean(score.rewards):.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
