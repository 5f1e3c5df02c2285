"""Steps a second of the Gymnasium environment: one, Gymnasium's vector of single ones, and ours on threads.

    python bridge/python/benches/vector_env.py [--envs 256] [--threads 2] [--plant icrik]

A step is a control period of one environment, ten of the simulation's, with its observation and reward; episodes that
end begin again. Random actions about straight on. `--min-steps` makes it a check of ours on threads: the exit status is
1 where it is slower.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import sidehill
from sidehill.gym import PathTracking, VectorPathTracking

SCENARIO = Path(__file__).resolve().parents[3] / "config/scenarios/figure_eight.yaml"


def steps_a_second(envs: Any, count: int, seconds: float) -> float:
    """Returns the steps of all environments within so many seconds, after a tenth of it to warm up."""
    random = np.random.default_rng(1)
    actions = random.uniform([0.2, -0.2], [0.6, 0.2], (64, count, 2)).astype(np.float32)
    envs.reset(seed=1)
    for begin_s in (0.1 * seconds, seconds):
        done, begin = 0, time.perf_counter()
        while time.perf_counter() - begin < begin_s:
            envs.step(actions[done % 64])
            done += 1
        rate = done * count / (time.perf_counter() - begin)
    return rate


def main(count: int, threads: list[int], plant: str, seconds: float) -> float:
    """Prints the table and returns the largest rate of ours on threads, 1/s."""
    scenario = sidehill.Scenario.load(SCENARIO)

    def single() -> PathTracking:
        return PathTracking(scenario, plant)

    print(f"plant {plant}, {count} environments, {os.cpu_count()} processors: steps a second")
    print(f"{'SyncVectorEnv of 1':28}{steps_a_second(gymnasium.vector.SyncVectorEnv([single]), 1, seconds):10.0f}")
    many = gymnasium.vector.SyncVectorEnv([single] * count)
    print(f"{'SyncVectorEnv':28}{steps_a_second(many, count, seconds):10.0f}")
    rates = []
    for number in threads:
        ours = VectorPathTracking(scenario, count, number, plant=plant)
        rates.append(steps_a_second(ours, count, seconds))
        print(f"{f'VectorPathTracking, {number} thread(s)':28}{rates[-1]:10.0f}")
    return max(rates)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--envs", type=int, default=256)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--plant", choices=("icrik", "contact"), default="icrik")
    parser.add_argument("--seconds", type=float, default=4)
    parser.add_argument("--min-steps", type=float, default=0)
    given = parser.parse_args()
    sys.exit(main(given.envs, given.threads, given.plant, given.seconds) < given.min_steps)
