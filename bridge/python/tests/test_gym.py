"""The Gymnasium environment."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import untyped

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from sidehill.gym import Baseline, PathTracking, VectorPathTracking  # noqa: E402


@pytest.mark.parametrize("plant", [None, "contact"])
def test_gymnasiums_own_checks_pass(short: sidehill.Scenario, plant: Any) -> None:
    pytest.importorskip("matplotlib")
    env = gymnasium.make("sidehill/PathTracking-v0", scenario=short, plant=plant, render_mode="rgb_array")
    # Warnings are errors.
    check_env(env.unwrapped)
    assert env.observation_space.is_bounded() and env.unwrapped.metadata["render_fps"] == 20


def test_what_is_far_off_is_clipped_to_the_bounds(short: sidehill.Scenario) -> None:
    env = PathTracking(short, lost_m=0.1, speed_max_m_s=0.1)
    observation, _ = env.reset(seed=1)
    assert observation in env.observation_space
    high = untyped(env.observation_space).high
    # The path's reference soon is farther than such a slow vehicle comes.
    assert observation[7 + 3 * 5 + 1] == high[7 + 3 * 5 + 1] == np.float32(2 * (0.1 + 0.1 * 6))
    over = False
    while not over:
        observation, _, over, _, _ = env.step(np.array([0.5, 1.0]))
        assert observation in env.observation_space


def test_a_picture_shows_where_the_vehicle_is(short: sidehill.Scenario) -> None:
    pytest.importorskip("matplotlib")
    env = PathTracking(short, render_mode="rgb_array")
    env.reset(seed=1)

    def red_at(picture: Any) -> Any:
        rows, columns = np.nonzero((picture[..., 0] > 180) & (picture[..., 1] < 90) & (picture[..., 2] < 90))
        assert rows.size > 20
        return rows.mean(), columns.mean()

    pictures = [env.render()]
    for _ in range(60):
        env.step(np.array([0.5, 0.0]))
    pictures.append(env.render())
    assert all(picture.shape == (480, 480, 3) and picture.dtype == np.uint8 for picture in pictures)
    # Along the path, which is straight ahead: by a metre in a picture of some metres.
    (row, column), (to_row, to_column) = map(red_at, pictures)
    assert 30 < math.hypot(to_row - row, to_column - column) < 300
    # The track from here to there is blue.
    blue = [((picture[..., 2] > 150) & (picture[..., 0] < 90)).sum() for picture in pictures]
    assert blue[1] > blue[0] + 30
    env.render_mode = None
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


def random_slope(short: sidehill.Scenario) -> Any:
    def scenario(random: Any) -> Any:
        slope_deg = float(random.uniform(0, 15))
        return short.with_(terrain={"kind": "plane", "slope_deg": slope_deg, "uphill_heading_deg": 20})

    return scenario


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("plant", [None, "contact"])
def test_a_vector_is_single_environments_bit_by_bit(short: sidehill.Scenario, threads: Any, plant: Any) -> None:
    count, keywords = 20, {"scenario": random_slope(short), "plant": plant, "lost_m": 0.4}
    ours = gymnasium.make_vec("sidehill/PathTracking-v0", num_envs=count, threads=threads, **keywords)
    single = gymnasium.vector.SyncVectorEnv([lambda: PathTracking(**keywords)] * count)
    assert isinstance(ours.unwrapped, VectorPathTracking)
    assert ours.observation_space == single.observation_space and ours.action_space == single.action_space
    assert ours.metadata == single.metadata

    def same(found: Any, expected: Any) -> None:
        *arrays, infos = found
        *others, expected_infos = expected
        for array, other in zip(arrays, others, strict=True):
            assert array.dtype == other.dtype
            np.testing.assert_array_equal(array, other)
        assert infos.keys() == expected_infos.keys()
        for key in infos:
            np.testing.assert_array_equal(infos[key], expected_infos[key])
            assert infos[key].dtype == expected_infos[key].dtype

    same(ours.reset(seed=3), single.reset(seed=3))
    random = np.random.default_rng(1)
    ended = 0
    for _ in range(400):
        actions = random.uniform([0.2, -0.3], [1.2, 0.3], (count, 2)).astype(np.float32)
        found = ours.step(actions)
        same(found, single.step(actions))
        ended += int((found[2] | found[3]).sum())
    assert ended > count
    for env, other in zip(ours.unwrapped.envs, single.envs, strict=True):
        assert env.simulation == other.simulation and env.scenario == other.scenario
    seeds: list[int | None] = [*range(4, 4 + count)]
    same(ours.reset(seed=seeds), single.reset(seed=seeds))


def test_all_may_end_at_once(short: sidehill.Scenario) -> None:
    envs = VectorPathTracking(short, num_envs=2, lost_m=0.01)
    envs.reset(seed=1)
    for _ in range(100):
        *_, terminated, _, infos = envs.step(np.array([[-1.0, 0.0], [-1.0, 0.0]]))
        if terminated.all():
            break
    assert infos["_finished"].all() and not infos["finished"].any()
    observations, rewards, terminated, *_ = envs.step(np.ones((2, 2)))
    assert not terminated.any() and not rewards.any() and (observations[:, 0] == 0).all()
    _, rewards, *_ = envs.step(np.full((2, 2), [0.3, 0.0]))
    assert (0 < rewards).all() and (rewards < short.period_s).all()


def episode(env: Any, policy: Any, seed: Any) -> Any:
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


def test_the_baseline_tracks_and_a_seed_repeats_every_bit(short: sidehill.Scenario) -> None:
    env = PathTracking(short, plant="contact")
    first = episode(env, Baseline(env), seed=4)
    observations, rewards, info, terminated = first
    assert terminated and info["finished"]
    # Column 0 is the cross-track error.
    assert np.abs(observations[:, 0]).max() < 0.02
    # What is covered earns what it takes at the speed asked for, less what the start takes.
    assert 0.85 < rewards.sum() / env.simulation.reference_end_s < 1
    again = episode(env, Baseline(env), seed=4)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])


def test_standing_earns_nothing_and_haste_no_more_than_the_time_it_takes(short: sidehill.Scenario) -> None:
    env = PathTracking(short)
    _, stood, info, _ = episode(env, lambda _: np.zeros(2), seed=1)
    assert not stood.any() and not info["finished"]
    env.reset(seed=1)
    _, hasty, *_ = env.step(np.array([1.0, 0.0]))
    for _ in range(5):
        _, hasty, *_ = env.step(np.array([1.0, 0.0]))
    assert 0.9 * short.period_s < hasty <= short.period_s


def test_an_observation_is_what_it_is_named_for(short: sidehill.Scenario) -> None:
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


def test_who_leaves_the_path_is_lost(short: sidehill.Scenario) -> None:
    env = PathTracking(short, lost_m=0.4)
    observations, rewards, info, terminated = episode(env, lambda _: np.array([-1.0, 0.0]), seed=1)
    assert terminated and info["finished"] is False and rewards[-1] <= -PathTracking.LOST_COST
    assert len(rewards) < 60


def test_a_function_makes_another_scenario_for_each_episode(short: sidehill.Scenario) -> None:
    def scenario(random: Any) -> Any:
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
        ({"render_mode": "human"}, "render_mode: "),
    ],
)
def test_what_is_wrong_is_named(short: sidehill.Scenario, keywords: Any, part: Any) -> None:
    with pytest.raises(ValueError, match=part):
        PathTracking(**({"scenario": short} | keywords))
    with pytest.raises(ValueError, match=part):
        VectorPathTracking(**({"scenario": short} | keywords))
    with pytest.raises(ValueError, match="env: "):
        Baseline(gymnasium.Env())


def test_a_wrong_step_is_refused_and_named(short: sidehill.Scenario) -> None:
    env, envs = PathTracking(short), VectorPathTracking(short, num_envs=3)
    env.reset(seed=1)
    envs.reset(seed=1)
    for one, wrong in ((env, [0.1]), (env, [0.1, math.nan]), (envs, [0.1, 0.1]), (envs, np.full((3, 2), np.inf))):
        with pytest.raises(ValueError, match="action: "):
            one.step(np.array(wrong))
    assert env.simulation.time_s == 0
    with pytest.raises(ValueError, match="seed: 2 for 3"):
        envs.reset(seed=[1, 2])
    with pytest.raises(ValueError, match="options: "):
        envs.reset(options={"reset_mask": np.ones(3, bool)})
    for keywords, part in (({"num_envs": 0}, "num_envs: "), ({"threads": 0}, "threads: ")):
        with pytest.raises(ValueError, match=part):
            VectorPathTracking(short, **keywords)
