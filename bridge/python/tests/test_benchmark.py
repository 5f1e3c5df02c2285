"""The benchmark of path tracking, and its learned rows."""

import importlib
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("gymnasium")
from sidehill import benchmark  # noqa: E402
from sidehill.gym import VectorPathTracking  # noqa: E402

sys.path.append(str(Path(__file__).parents[1] / "benches"))
path_tracking: Any = importlib.import_module("path_tracking")


def test_a_seed_is_an_episode_and_the_family_is_as_wide_as_it_says() -> None:
    first, second = (benchmark.scenario(np.random.default_rng(seed)) for seed in (5, 6))
    assert first == benchmark.scenario(np.random.default_rng(5)) != second
    drawn = [benchmark.scenario(np.random.default_rng(seed)) for seed in range(60)]
    sizes = [each.vehicle.base_half_width_m / 0.6 for each in drawn]
    slopes_deg = [math.degrees(math.acos(math.cos(r) * math.cos(p))) for r, p in (each.start_attitude_rad for each in drawn)]
    assert min(sizes) < 0.55 and max(sizes) > 0.95 and 0.5 <= min(sizes) and max(sizes) <= 1
    assert min(slopes_deg) < 2 and max(slopes_deg) > 13 and max(slopes_deg) <= 15 + 1e-9


def test_the_learned_rows_are_better_than_nothing_and_the_controller_better_than_these() -> None:
    seeds = benchmark.SEEDS[:4]
    told = benchmark.score(path_tracking.controller("icrik-mpc"), seeds)
    learned = {name: benchmark.score(path_tracking.learned(name), seeds) for name in ("clone", "search")}
    assert told.finished.all() and np.median(told.cross_track_rms_m) < 0.002
    for name, score in learned.items():
        assert score.finished.sum() >= 3, name
        assert 0.002 < np.median(score.cross_track_rms_m) < 0.15, (name, score)
    assert str(told).startswith("4 of 4 to the end, cross-track RMS 0.0")


def test_a_policy_that_stands_finishes_nothing() -> None:
    score = benchmark.score(lambda env: lambda observation: np.zeros(2), benchmark.SEEDS[:2])
    assert not score.finished.any() and np.isinf(score.cross_track_rms_m).all()
    assert (abs(score.rewards) < 1e-6).all() and (score.steer_variation_m_s == 0).all()


def test_an_episode_is_that_of_the_vector_environment() -> None:
    seed = benchmark.SEEDS[0]
    envs = VectorPathTracking(benchmark.scenario, num_envs=1)
    observations, _ = envs.reset(seed=seed)
    network = path_tracking.Network.load("search")
    total, over = 0.0, False
    while not over:
        observations, rewards, terminated, truncated, _ = envs.step(np.clip(network(observations), -1, 1))
        total += float(rewards[0])
        over = bool(terminated[0] or truncated[0])
    assert total == benchmark.score(path_tracking.learned("search"), [seed]).rewards[0]


def test_a_clone_learns_what_it_is_shown() -> None:
    random = np.random.default_rng(3)
    x = random.normal(size=(2000, 5))
    y = np.tanh(x[:, :2] - x[:, 3:])
    layers = [(random.normal(0, 0.5, (5, 16)), np.zeros(16)), (random.normal(0, 0.3, (16, 2)), np.zeros(2))]
    network = path_tracking.Network(layers, np.zeros(5), np.ones(5))
    before = ((network(x) - y) ** 2).mean()
    after = path_tracking._fitted(network, x, y, 300, random)
    assert after < 0.05 * before
