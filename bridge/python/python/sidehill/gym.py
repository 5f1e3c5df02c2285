"""A Gymnasium environment: a rover on a slope that is to follow a path, with a controller as baseline.

    import gymnasium, sidehill, sidehill.gym

    scenario = sidehill.Scenario.load("figure_eight_15deg.yaml")
    env = gymnasium.make("sidehill/PathTracking-v0", scenario=scenario)
    envs = gymnasium.make_vec("sidehill/PathTracking-v0", num_envs=256, scenario=scenario)

Needs `pip install gymnasium`, and pictures matplotlib. The vehicle is the scenario's plant with its drive train; readings
are the truth. `make_vec` makes a VectorPathTracking.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from . import _sidehill
from ._kinds import Kind
from ._sidehill import Controller, Decision, Scenario, Simulation, Vehicle

_Floats = npt.NDArray[np.float32]
_Doubles = npt.NDArray[np.float64]
_Flags = npt.NDArray[np.bool_]

ERROR_SCALE_M = 0.1
"""Distance from the reference that costs 1 a second, as much as driving as asked earns."""
STEER_CHANGE_COST = 0.1
"""Cost of changing the steer command by 1 m/s: turning to and fro slides a rover downhill."""


class PathTracking(gymnasium.Env[_Floats, _Floats]):
    """Follow the scenario's reference.

    scenario: what is driven; or a function of `self.np_random` that returns another one for each episode.
    plant: "icrik" or "contact", instead of the scenario's.
    preview_s: instants ahead, s, at which the reference is shown.
    lost_m: distance from the reference at which an episode ends.
    speed_max_m_s: traction and steer of the action 1, m/s.
    render_mode: "rgb_array" for pictures from above by render(), which need matplotlib.

    Action, in [-1, 1]: effective traction and steer in shares of `speed_max_m_s`; counter-clockwise is positive. The left
    tread drives at traction - steer, the right one at traction + steer.

    Observation, float32: cross-track error (m, left of travel positive), error along the path (m, ahead positive),
    heading error (rad), roll and pitch (rad), effective speeds of the left and right tread (m/s); then for each
    instant of `preview_s` the reference as seen from the vehicle: right (m), forward (m), turn to its heading (rad).
    What is beyond the bounds of `observation_space` is clipped: errors at 2 lost_m, speeds at 2 speed_max_m_s, and the
    reference at 2 lost_m and what is driven until then at twice speed_max_m_s.

    Reward, per step of the scenario's control period: what it covered of the reference, in seconds at the speed asked for
    and at most its duration, less its duration times (distance from the reference / ERROR_SCALE_M)^2, less
    STEER_CHANGE_COST times the change of steer in m/s. An episode terminates where the vehicle stands at the end of the
    reference, is `lost_m` away (a reward of -LOST_COST) or leaves the known ground (likewise); it is truncated after one
    and a half times the reference's duration and 30 s. `info` has `cross_track_m`, and at the end `finished`.

    Raises ValueError with the argument's name and value.
    """

    LOST_COST = 100.0
    """Cost of leaving the path, without unit."""
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(
        self,
        scenario: Scenario | Callable[[np.random.Generator], Scenario],
        plant: str | None = None,
        preview_s: tuple[float, ...] = (0.5, 1.0, 2.0, 3.0, 4.5, 6.0),
        lost_m: float = 1.0,
        speed_max_m_s: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        if not (isinstance(scenario, Scenario) or callable(scenario)):
            raise ValueError(f"scenario: a sidehill.Scenario or a function is needed, not {scenario!r}")
        for name, value in (("lost_m", lost_m), ("speed_max_m_s", speed_max_m_s)):
            if not 0 < value < math.inf:
                raise ValueError(f"{name}: {value!r} is not a positive number")
        if not all(0 <= ahead < math.inf for ahead in preview_s):
            raise ValueError(f"preview_s: {preview_s!r} are not instants from 0 s on")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode: {render_mode!r} is not rgb_array")
        self._next = scenario
        self._plant = plant
        self._preview_s = np.array(preview_s, np.float64)
        self.lost_m, self.speed_max_m_s, self.render_mode = lost_m, speed_max_m_s, render_mode
        if isinstance(scenario, Scenario):
            self.metadata = self.metadata | {"render_fps": round(1 / scenario.period_s)}
        self.scenario: Scenario
        self.vehicle: Vehicle
        self.simulation: Simulation
        self._steer_m_s, self._progress_s = np.zeros(1), np.zeros(1)
        self._picture: Any = None
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        bounds = [2 * lost_m, 2 * lost_m, math.pi, math.pi / 2, math.pi / 2, 2 * speed_max_m_s, 2 * speed_max_m_s]
        for ahead_s in preview_s:
            reach_m = 2 * (lost_m + speed_max_m_s * ahead_s)
            bounds += [reach_m, reach_m, math.pi]
        high = np.array(bounds, np.float32)
        self.observation_space = gymnasium.spaces.Box(-high, high, dtype=np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[_Floats, dict[str, Any]]:
        """Begins an episode and returns the observation, shape (7 + 3 k,), and `info`.

        seed: makes the function's scenario and everything random in the plant. options: none are known.

        Raises ValueError where the function's or the plant's scenario is wrong.
        """
        super().reset(seed=seed)
        self.scenario = self._next if isinstance(self._next, Scenario) else self._next(self.np_random)
        plant: Any = self._plant
        self.simulation = Simulation(self.scenario, plant, int(self.np_random.integers(2**32)))
        self.vehicle = self.simulation.vehicle
        self._picture = None
        # What `_drive` needs of each episode: c_l, c_r, control period and largest duration, s.
        constants = [self.vehicle.correction_left, self.vehicle.correction_right, self.scenario.period_s]
        self._constants = np.array([*constants, 1.5 * self.simulation.reference_end_s + 30])
        row = _sidehill.drive([self.simulation], None, self._constants[2:3], self._preview_s, 1)
        self._steer_m_s, self._progress_s = np.zeros(1), row[:, -4].copy()
        return _observed(row, self)[0], {"cross_track_m": float(row[0, 0])}

    def step(self, action: npt.NDArray[np.floating[Any]]) -> tuple[_Floats, float, bool, bool, dict[str, Any]]:
        """Drives for a control period with an action of shape (2,).

        Returns observation, reward, terminated, truncated and info. Raises ValueError where the action has another
        shape or is not finite.
        """
        before = self._constants[None], self._steer_m_s, self._progress_s
        step = _drive(self, [self.simulation], *before, np.asarray(action)[None], 1)
        self._steer_m_s, self._progress_s = step.steer_m_s, step.progress_s
        terminated, truncated = bool(step.terminated[0]), bool(step.truncated[0])
        info: dict[str, Any] = {"cross_track_m": float(step.cross_track_m[0])}
        if terminated or truncated:
            info["finished"] = bool(step.finished[0])
        return step.observations[0], float(step.rewards[0]), terminated, truncated, info

    def render(self) -> Any:
        """Returns the picture from above: array of shape (480, 480, 3), uint8.

        It has contours of the ground's height, the path, the track since render() was first called in this episode, and
        the vehicle. None without a render_mode. Raises DependencyNotInstalled without matplotlib.
        """
        if self.render_mode is None:
            gymnasium.logger.warn('render() gives nothing: make the environment with render_mode="rgb_array"')
            return None
        if self._picture is None:
            from ._picture import Picture

            self._picture = Picture(self.scenario, self.vehicle, self.simulation)
        return self._picture.drawn(self.simulation)


class VectorPathTracking(gymnasium.vector.VectorEnv[_Floats, _Floats, npt.NDArray[Any]]):
    """As many PathTracking as `num_envs`, which drive on threads without the interpreter's lock.

    scenario: what all drive, or a function that is called for each episode of each.
    threads: their number; as many as there are processors by default.

    The other arguments (`keywords`), spaces, rewards and infos are those of PathTracking, with an axis for the environments first.
    Trajectories are those of `gymnasium.vector.SyncVectorEnv` of PathTracking bit by bit, on any number of threads. One
    whose episode has ended begins the next one at the next step (AutoresetMode.NEXT_STEP), which leaves out its action.

    Raises ValueError with the argument's name and value.
    """

    def __init__(
        self,
        scenario: Scenario | Callable[[np.random.Generator], Scenario],
        num_envs: int = 1,
        threads: int | None = None,
        **keywords: Any,
    ) -> None:
        for name, value in (("num_envs", num_envs), ("threads", threads)):
            if value is not None and not value > 0:
                raise ValueError(f"{name}: {value!r} is not a positive number")
        self.envs = [PathTracking(scenario, **keywords) for _ in range(num_envs)]
        """The environments, whose `simulation`, `scenario` and `vehicle` may be read."""
        self.num_envs = num_envs
        self.threads = threads or os.cpu_count() or 1
        self.metadata = self.envs[0].metadata | {"autoreset_mode": AutoresetMode.NEXT_STEP}
        self.render_mode = self.envs[0].render_mode
        self.single_action_space, self.single_observation_space = self.envs[0].action_space, self.envs[0].observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._over = np.zeros(num_envs, np.bool_)
        self._simulations: list[Simulation] = []
        self._constants = np.zeros((num_envs, 4))
        self._steer_m_s, self._progress_s = np.zeros(num_envs), np.zeros(num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[_Floats, dict[str, Any]]:
        """Begins an episode in all environments and returns observations, shape (num_envs, 7 + 3 k), and infos.

        seed: of the first environment, those of the others follow; or a list with one each. Raises ValueError where the
        list has another length, and for `options`, as there are none.
        """
        if options:
            raise ValueError(f"options: none are known, not {options!r}")
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed or [None] * self.num_envs
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: {len(seeds)} for {self.num_envs} environments")
        begun = [env.reset(seed=each) for env, each in zip(self.envs, seeds, strict=True)]
        self._over = np.zeros(self.num_envs, np.bool_)
        self._simulations = [env.simulation for env in self.envs]
        self._constants = np.array([env._constants for env in self.envs])
        self._steer_m_s = np.zeros(self.num_envs)
        self._progress_s = np.array([env._progress_s[0] for env in self.envs])
        return np.stack([observation for observation, _ in begun]), {
            "cross_track_m": np.array([info["cross_track_m"] for _, info in begun]),
            "_cross_track_m": np.ones(self.num_envs, np.bool_),
        }

    def step(self, actions: npt.NDArray[np.floating[Any]]) -> tuple[_Floats, _Doubles, _Flags, _Flags, dict[str, Any]]:
        """Drives all environments for a control period with actions of shape (num_envs, 2).

        Returns observations, rewards, terminations, truncations, each of shape (num_envs, ...), and infos. Raises
        ValueError where actions have another shape or are not finite.
        """
        actions = np.asarray(actions)
        count = self.num_envs
        if actions.shape != (count, 2):
            raise ValueError(f"action: the shape ({count}, 2) is needed, not {actions.shape}")
        if not self._over.any():
            before = self._constants, self._steer_m_s, self._progress_s
            step = _drive(self.envs[0], self._simulations, *before, actions, self.threads)
        else:
            begins, drives = np.flatnonzero(self._over), np.flatnonzero(~self._over)
            simulations = [self._simulations[index] for index in drives]
            before = self._constants[drives], self._steer_m_s[drives], self._progress_s[drives]
            step = _drive(self.envs[0], simulations, *before, actions[drives], self.threads)
            parts: list[npt.NDArray[Any]] = list(step)
            spread = [np.zeros((count, *part.shape[1:]), part.dtype) for part in parts]
            for whole, part in zip(spread, parts, strict=True):
                whole[drives] = part
            step = _Step._make(spread)
            for index in begins:
                step.observations[index], info = self.envs[index].reset()
                step.cross_track_m[index], step.progress_s[index] = info["cross_track_m"], self.envs[index]._progress_s[0]
                self._simulations[index], self._constants[index] = self.envs[index].simulation, self.envs[index]._constants
        self._steer_m_s, self._progress_s = step.steer_m_s, step.progress_s
        self._over = step.terminated | step.truncated
        infos: dict[str, Any] = {"cross_track_m": step.cross_track_m, "_cross_track_m": np.ones(count, np.bool_)}
        if self._over.any():
            infos |= {"finished": step.finished & self._over, "_finished": self._over.copy()}
        return step.observations, step.rewards, step.terminated, step.truncated, infos

    def render(self) -> tuple[Any, ...] | None:
        """Returns the pictures of all environments, see PathTracking.render; None without a render_mode."""
        return None if self.render_mode is None else tuple(env.render() for env in self.envs)


def _observed(rows: _Doubles, env: PathTracking) -> _Floats:
    """Returns observations: what the core gives of each environment, within their bounds."""
    space = env.observation_space
    assert isinstance(space, gymnasium.spaces.Box)
    return np.clip(rows[:, :-5].astype(np.float32), space.low, space.high)


class _Step(NamedTuple):
    """What a step of n environments gives, an element each."""

    observations: _Floats
    rewards: _Doubles
    terminated: _Flags
    truncated: _Flags
    cross_track_m: _Doubles
    finished: _Flags
    steer_m_s: _Doubles
    progress_s: _Doubles


def _drive(
    like: PathTracking,
    simulations: list[Simulation],
    constants: _Doubles,
    steer_before_m_s: _Doubles,
    progress_before_s: _Doubles,
    actions: npt.NDArray[Any],
    threads: int,
) -> _Step:
    """Drives the simulations of environments that were made as `like` was for a control period."""
    if actions.shape != (len(simulations), 2) or not np.isfinite(actions).all():
        raise ValueError(f"action: two finite numbers are needed, not {actions!r}")
    told = np.clip(actions.astype(np.float64), -1, 1) * like.speed_max_m_s
    traction, steer = told[:, 0], told[:, 1]
    left, right, dt_s, time_max_s = constants.T
    # Equation (11), solved for what the drives are told.
    speeds = np.stack([(traction - steer) / left, (traction + steer) / right], -1).ravel()
    rows = _sidehill.drive(simulations, speeds, dt_s.copy(), like._preview_s, threads)
    distance_m, progress_s, time_s, ended, failed = rows[:, -5:].T
    # A step fails where the known ground ends.
    lost = (failed > 0) | (distance_m > like.lost_m)
    scaled = distance_m / ERROR_SCALE_M
    covered_s = np.minimum(progress_s - progress_before_s, dt_s)
    costs = STEER_CHANGE_COST * abs(steer - steer_before_m_s) + dt_s * (scaled * scaled) + np.where(lost, like.LOST_COST, 0.0)
    finished = (ended > 0) & ~lost
    flags = lost | finished, time_s > time_max_s
    return _Step(_observed(rows, like), covered_s - costs, *flags, rows[:, 0].copy(), finished, steer, progress_s.copy())


class Baseline:
    """A policy: one of Sidehill's controllers in the environment's place of an agent.

    env: a PathTracking, also one of VectorPathTracking.envs, or a wrapper of one. kind: the controller's name.

    It reads the simulation itself, not the observation. Call `reset()` after the environment's, then the object with
    each observation. Raises ValueError with the argument's name.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], kind: Kind = "icrik-mpc") -> None:
        tracking = env.unwrapped
        if not isinstance(tracking, PathTracking):
            raise ValueError(f"env: a {PathTracking.__name__} is needed, not {env!r}")
        self._env = tracking
        self._kind: Kind = kind
        self._controller: Controller | None = None
        self.decision: Decision | None = None
        """What the controller decided last."""

    def reset(self) -> None:
        """Begins an episode with a new controller for the environment's scenario."""
        self._controller = Controller(self._env.scenario, self._kind, self._env.vehicle)

    def __call__(self, observation: Any = None) -> _Floats:
        """Returns the action of this step, shape (2,); the observation is not needed. Raises what Controller.step does."""
        if self._controller is None:
            self.reset()
        assert self._controller is not None
        simulation = self._env.simulation
        time_s = simulation.time_s
        decision = self._controller.step(
            time_s,
            tread_speeds_m_s=simulation.tread_speeds_m_s,
            attitude_rad=simulation.attitude_rad,
            pose=(time_s, *simulation.pose),
        )
        self.decision = decision
        command = np.array([decision.traction_m_s, decision.steer_m_s])
        return (command / self._env.speed_max_m_s).astype(np.float32)


gymnasium.register(
    id="sidehill/PathTracking-v0",
    entry_point="sidehill.gym:PathTracking",
    vector_entry_point="sidehill.gym:VectorPathTracking",
)
