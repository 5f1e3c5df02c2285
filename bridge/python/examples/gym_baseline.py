"""The Gymnasium environment with controllers as baselines, on slopes of random steepness and direction.

    pip install gymnasium
    python bridge/python/examples/gym_baseline.py

An agent takes the place of `Baseline`: it gets the observation and returns the action.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import sidehill
import sidehill.gym

CONFIG = Path(__file__).resolve().parents[3] / "config"


def slopes(random: np.random.Generator) -> sidehill.Scenario:
    """Returns a figure of eight on wheels with friction; the slope is another one in each episode."""
    eight = sidehill.Scenario.load(CONFIG / "scenarios/figure_eight.yaml")
    slope_deg, uphill_deg = float(random.uniform(3, 15)), float(random.uniform(-180, 180))
    return eight.with_(
        course={"shape": "figure_eight", "half_width_m": 1.6, "half_length_m": 2.6, "period_s": 40},
        terrain={"kind": "plane", "slope_deg": slope_deg, "uphill_heading_deg": uphill_deg},
    )


def episode(env: gymnasium.Env[Any, Any], kind: sidehill.Kind, seed: int) -> tuple[float, float, bool]:
    """Returns the reward of an episode, the cross-track RMS after 2 s in m, and whether it came to its end."""
    observation, info = env.reset(seed=seed)
    policy = sidehill.gym.Baseline(env, kind)
    total, over = 0.0, False
    squares: list[float] = []
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        total += float(reward)
        squares.append(info["cross_track_m"] ** 2)
        over = terminated or truncated
    tracking = env.unwrapped
    assert isinstance(tracking, sidehill.gym.PathTracking)
    settled = squares[round(2 / tracking.scenario.period_s) :]
    return total, math.sqrt(np.mean(settled)), info["finished"]


def main(episodes: int = 3) -> dict[str, list[tuple[float, float, bool]]]:
    env = gymnasium.make("sidehill/PathTracking-v0", scenario=slopes, plant="contact")
    found: dict[str, list[tuple[float, float, bool]]] = {}
    kinds: tuple[sidehill.Kind, ...] = ("icrik-mpc", "icrhk-mpc", "pure-pursuit")
    for kind in kinds:
        found[kind] = [episode(env, kind, seed) for seed in range(episodes)]
        rewards, errors, finished = zip(*found[kind], strict=True)
        print(
            f"{kind}: {sum(finished)} of {episodes} to the end, mean reward {np.mean(rewards):.1f}, "
            f"cross-track RMS {', '.join(f'{100 * error:.2f}' for error in errors)} cm"
        )
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=3)
    main(parser.parse_args().episodes)
