"""A benchmark of path tracking: a family of rovers, slopes and paths, with held-out seeds for scores that compare.

    import sidehill.benchmark as benchmark

    envs = gymnasium.make_vec("sidehill/PathTracking-v0", num_envs=64, scenario=benchmark.scenario)   # to train on
    print(benchmark.score(lambda env: agent))                                                         # to be compared

A policy is a function that takes the episode's PathTracking and returns a function from observation to action. One that
learns uses the observation alone; `lambda env: sidehill.gym.Baseline(env, "icrik-mpc")` scores a controller, which is told
the rover and reads its state. The table of `bridge/python/benches/path_tracking.md` takes further rows.

Needs `pip install gymnasium`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ._sidehill import Scenario, Vehicle
from .gym import PathTracking

Policy = Callable[[PathTracking], Callable[[npt.NDArray[np.float32]], npt.NDArray[np.floating[Any]]]]

SEEDS = range(1_000_000, 1_000_100)
"""Seeds of the episodes that `score` drives; do not train on them."""
COUNTS_FROM_S = 2.0
"""Time after the start from which errors count, s."""


def scenario(random: np.random.Generator) -> Scenario:
    """Returns a member of the family, for the argument `scenario` of PathTracking and `make_vec`.

    A rover of 0.5 to 1 times the J8's size, with slide gains of 0.5 to 1.5 times the J8's, on a plane of 0 to 15 deg in any
    direction, follows a path of 25 m whose curvature wanders within +-0.6 1/m, at 0.3 to 0.8 m/s.
    """
    j8 = Vehicle.j8()
    size = random.uniform(0.5, 1.0)
    width = random.uniform(0.8, 1.3)
    half_width_m = size * j8.base_half_width_m
    vehicle = j8.with_(
        x_icr_left_m=size * width * j8.x_icr_left_m,
        x_icr_right_m=size * width * j8.x_icr_right_m,
        y_icr_m=size * j8.base_half_length_m * random.uniform(-0.1, 0.25),
        lambda_1_s_per_rad=random.uniform(0.5, 1.5) * j8.lambda_1_s_per_rad,
        lambda_2_s_per_rad=random.uniform(0.5, 1.5) * j8.lambda_2_s_per_rad,
        base_half_width_m=half_width_m,
        base_half_length_m=size * j8.base_half_length_m,
    )
    slope = {"kind": "plane", "slope_deg": random.uniform(0, 15), "uphill_heading_deg": random.uniform(-180, 180)}
    return Scenario(
        name="path-tracking",
        vehicle=vehicle,
        terrain=slope,
        path=_path(random),
        speed={"speed_m_s": random.uniform(0.3, 0.8)},
        plant="icrik",
        controllers=["icrik-mpc"],
    )


def _path(random: np.random.Generator, length_m: float = 25.0, step_m: float = 0.25) -> npt.NDArray[np.float64]:
    """Returns points of a path whose curvature is linear between random values 3 m apart."""
    along_m = np.arange(0, length_m + step_m, step_m)
    knots_m = np.arange(0, length_m + 3, 3.0)
    curvature_per_m = np.interp(along_m, knots_m, random.uniform(-0.6, 0.6, len(knots_m)))
    heading_rad = random.uniform(-math.pi, math.pi) + np.cumsum(curvature_per_m) * step_m
    steps_m = step_m * np.stack([-np.sin(heading_rad), np.cos(heading_rad)], -1)
    return np.cumsum(steps_m, axis=0)


@dataclass(frozen=True)
class Score:
    """What a policy reached; an element of the arrays for each seed."""

    rewards: npt.NDArray[np.float64]
    """Sums of an episode's rewards."""
    cross_track_rms_m: npt.NDArray[np.float64]
    """Root of the mean squared distance from the path after COUNTS_FROM_S, m; infinite where it was not finished."""
    steer_variation_m_s: npt.NDArray[np.float64]
    """Sums of the changes of the steer command, m/s."""
    finished: npt.NDArray[np.bool_]
    """Whether the end of the path was reached."""

    def __str__(self) -> str:
        median_m, worse_m = np.quantile(self.cross_track_rms_m, [0.5, 0.95], method="higher")
        return (
            f"{int(self.finished.sum())} of {len(self.finished)} to the end, cross-track RMS {100 * median_m:.2f} cm "
            f"(median), {100 * worse_m:.2f} cm (95 %), steer variation {np.mean(self.steer_variation_m_s):.1f} m/s, "
            f"reward {np.mean(self.rewards):.1f}"
        )


def score(policy: Policy, seeds: Iterable[int] = SEEDS) -> Score:
    """Returns what a policy reaches in the episodes of `seeds`, each begun with `PathTracking.reset(seed=...)`.

    policy: called with the environment at the start of each episode.
    seeds: those of SEEDS without it, by which scores compare.

    Raises what the policy raises.
    """
    env = PathTracking(scenario)
    rewards, errors_m, variations_m_s, finished = zip(*(_episode(env, policy, seed) for seed in seeds), strict=True)
    return Score(np.array(rewards), np.array(errors_m), np.array(variations_m_s), np.array(finished))


def _episode(env: PathTracking, policy: Policy, seed: int) -> tuple[float, float, float, bool]:
    observation, _ = env.reset(seed=seed)
    act = policy(env)
    total, steer_m_s, variation_m_s, over = 0.0, 0.0, 0.0, False
    squares: list[float] = []
    info: dict[str, Any] = {}
    while not over:
        action = np.clip(np.asarray(act(observation), np.float64), -1, 1)
        observation, reward, terminated, truncated, info = env.step(action)
        total += reward
        variation_m_s += abs(float(action[1]) * env.speed_max_m_s - steer_m_s)
        steer_m_s = float(action[1]) * env.speed_max_m_s
        squares.append(info["cross_track_m"] ** 2)
        over = terminated or truncated
    settled = squares[round(COUNTS_FROM_S / env.scenario.period_s) :]
    rms_m = math.sqrt(float(np.mean(settled))) if info["finished"] else math.inf
    return total, rms_m, variation_m_s, info["finished"]
