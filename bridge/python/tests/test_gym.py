"""The Gymnasium environment."""

import math

import numpy as np
import pytest
import sidehill

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from sidehill.gym import Baseline, PathTracking  # noqa: E402


@pytest.mark.parametrize("plant", [None, "contact"])
def test_gymnasiums_own_checks_pass(short, plant):
    env = gymnasium.make("sidehill/PathTracking-v0", scenario=short, plant=plant)
    # The action bounds are shares; observations have units and no bounds; there is nothing to render.
    with pytest.warns(UserWarning) as warned:
        check_env(env.unwrapped, skip_render_check=True)
    assert all("infinity" in str(each.message) or "PathTracking-v0" in str(each.message) for each in warned), [
        str(each.message) for each in warned
    ]


def episode(env, policy, seed):
    observation, info = env.reset(seed=seed)
    if isinstance(policy, Baseline):
        policy.reset()
    observations, rewards = [observation], []
    while True:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        observations.append(observation)
        rewards.append(reward)
        if terminated or truncated:
            return np.array(observations), np.array(rewards), info, terminated


def test_the_baseline_tracks_and_a_seed_repeats_every_bit(short):
    env = PathTracking(short, plant="contact")
    first = episode(env, Baseline(env), seed=4)
    observations, rewards, info, terminated = first
    assert terminated and info["finished"]
    # Column 0 is the cross-track error.
    assert np.abs(observations[:, 0]).max() < 0.02
    assert -1 < rewards.sum() < 0
    again = episode(env, Baseline(env), seed=4)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])


def test_an_observation_is_what_it_is_named_for(short):
    env = PathTracking(short, preview_s=(0.0, 4.0))
    observation, info = env.reset(seed=1)
    assert observation.shape == env.observation_space.shape == (13,)
    cross, along, heading, roll, pitch, left, right = observation[:7]
    assert (cross, left, right) == (0, 0, 0) and info["cross_track_m"] == 0
    assert (roll, pitch) == pytest.approx(short.start_attitude_rad, abs=1e-6)
    # The path is straight ahead of the rover's heading at its start.
    np.testing.assert_allclose(observation[7:10], 0, atol=1e-6)
    assert observation[10] == pytest.approx(0, abs=1e-6) and 0.5 < observation[11] <= 2
    # Left of the path: positive, and the path is to the right.
    for _ in range(10):
        observation, *_ = env.step(np.array([0.3, 0.3]))
    for _ in range(40):
        observation, *_ = env.step(np.array([0.5, 0.0]))
    assert observation[0] > 0.05 and observation[2] > 0.1 and observation[7] > 0.05 and observation[12] < -0.1


def test_who_leaves_the_path_is_lost(short):
    env = PathTracking(short, lost_m=0.4)
    observations, rewards, info, terminated = episode(env, lambda _: np.array([-1.0, 0.0]), seed=1)
    assert terminated and info["finished"] is False and rewards[-1] <= -PathTracking.LOST_COST
    assert len(rewards) < 60


def test_a_function_makes_another_scenario_for_each_episode(short):
    def scenario(random):
        slope_deg = float(random.uniform(0, 15))
        return short.with_(terrain={"kind": "plane", "slope_deg": slope_deg, "uphill_heading_deg": 0})

    env = PathTracking(scenario)
    slopes = []
    for seed in (1, None, None, 1):
        env.reset(seed=seed)
        slopes.append(env.scenario.to_dict()["terrain"]["slope_deg"])
    assert slopes[0] == slopes[3] and len(set(slopes)) == 3


@pytest.mark.parametrize(
    ("keywords", "part"),
    [
        ({"scenario": None}, "scenario: "),
        ({"scenario": "figure_eight.yaml"}, "scenario: "),
        ({"lost_m": 0}, "lost_m: "),
        ({"lost_m": math.nan}, "lost_m: "),
        ({"speed_max_m_s": -1}, "speed_max_m_s: "),
        ({"preview_s": (1.0, -1.0)}, "preview_s: "),
    ],
)
def test_what_is_wrong_is_named(short, keywords, part):
    with pytest.raises(ValueError, match=part):
        PathTracking(**({"scenario": short} | keywords))
    with pytest.raises(ValueError, match="env: "):
        Baseline(gymnasium.Env())
