"""A Gymnasium environment: a rover on a slope that is to follow a path, with a controller as baseline.

    import gymnasium, sidehill, sidehill.gym

    env = gymnasium.make("sidehill/PathTracking-v0", scenario=sidehill.Scenario.load("figure_eight_15deg.yaml"))

Needs `pip install gymnasium`. The vehicle is the scenario's plant with its drive train; readings are the truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from ._kinds import Kind
from ._sidehill import Controller, Decision, Scenario, Simulation, Vehicle

_Floats = npt.NDArray[np.float32]

ERROR_SCALE_M = 0.1
"""Distance from the reference that costs 1 a second."""
STEER_CHANGE_COST = 0.1
"""Cost of changing the steer command by 1 m/s: turning to and fro slides a rover downhill."""


class PathTracking(gymnasium.Env[_Floats, _Floats]):
    """Follow the scenario's reference.

    scenario: what is driven; or a function of `self.np_random` that returns another one for each episode.
    plant: "icrik" or "contact", instead of the scenario's.
    preview_s: instants ahead, s, at which the reference is shown.
    lost_m: distance from the reference at which an episode ends.

    Action, in [-1, 1]: effective traction and steer in shares of `speed_max_m_s`; counter-clockwise is positive. The left
    tread drives at traction - steer, the right one at traction + steer.

    Observation, float32: cross-track error (m, left of travel positive), error along the path (m, ahead positive),
    heading error (rad), roll and pitch (rad), effective speeds of the left and right tread (m/s); then for each
    instant of `preview_s` the reference as seen from the vehicle: right (m), forward (m), turn to its heading (rad).

    Reward, per step of the scenario's control period: its duration times -(distance from the reference /
    ERROR_SCALE_M)^2, less STEER_CHANGE_COST times the change of steer in m/s. An episode terminates at the end of the
    reference, where the vehicle is `lost_m` away (a reward of -LOST_COST) or where the known ground ends (likewise);
    it is truncated after one and a half times the reference's duration and 30 s. `info` has `cross_track_m`, and at the
    end `finished`.
    """

    LOST_COST = 100.0
    metadata = {"render_modes": []}

    def __init__(
        self,
        scenario: Scenario | Callable[[np.random.Generator], Scenario],
        plant: str | None = None,
        preview_s: tuple[float, ...] = (0.5, 1.0, 2.0, 3.0, 4.5, 6.0),
        lost_m: float = 1.0,
        speed_max_m_s: float = 1.0,
    ) -> None:
        if not (isinstance(scenario, Scenario) or callable(scenario)):
            raise ValueError(f"scenario: a sidehill.Scenario or a function is needed, not {scenario!r}")
        for name, value in (("lost_m", lost_m), ("speed_max_m_s", speed_max_m_s)):
            if not 0 < value < math.inf:
                raise ValueError(f"{name}: {value!r} is not a positive number")
        if not all(0 <= ahead < math.inf for ahead in preview_s):
            raise ValueError(f"preview_s: {preview_s!r} are not instants from 0 s on")
        self._next = scenario
        self._plant = plant
        self._preview_s = tuple(preview_s)
        self.lost_m, self.speed_max_m_s = lost_m, speed_max_m_s
        self.scenario: Scenario
        self.vehicle: Vehicle
        self.simulation: Simulation
        self._steer_m_s = 0.0
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        shape = (7 + 3 * len(self._preview_s),)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[_Floats, dict[str, Any]]:
        """Begins an episode. The seed makes the function's scenario and everything random in the plant."""
        super().reset(seed=seed)
        self.scenario = self._next if isinstance(self._next, Scenario) else self._next(self.np_random)
        plant: Any = self._plant
        self.simulation = Simulation(self.scenario, plant, int(self.np_random.integers(2**32)))
        self.vehicle = self.simulation.vehicle
        self._steer_m_s = 0.0
        return self._observation(), self._info()

    def step(self, action: _Floats) -> tuple[_Floats, float, bool, bool, dict[str, Any]]:
        """Drives for a control period."""
        traction, steer = np.clip(np.asarray(action, np.float64), -1, 1) * self.speed_max_m_s
        dt_s = self.scenario.period_s
        reward = -STEER_CHANGE_COST * abs(steer - self._steer_m_s)
        self._steer_m_s = float(steer)
        # Equation (11), solved for what the drives are told.
        left = float(traction - steer) / self.vehicle.correction_left
        right = float(traction + steer) / self.vehicle.correction_right
        lost = False
        try:
            self.simulation.step(left, right, dt_s)
        except ValueError:
            # The known ground ends here.
            lost = True
        x_m, y_m, _, _ = self.simulation.pose
        reference = self.simulation.reference(0.0)
        distance_m = math.hypot(x_m - reference[0], y_m - reference[1])
        reward -= dt_s * (distance_m / ERROR_SCALE_M) ** 2
        lost |= distance_m > self.lost_m
        if lost:
            reward -= self.LOST_COST
        finished = self.simulation.finished
        truncated = self.simulation.time_s > 1.5 * self.simulation.reference_end_s + 30
        info = self._info() | ({"finished": finished and not lost} if lost or finished or truncated else {})
        return self._observation(), float(reward), lost or finished, truncated, info

    def _info(self) -> dict[str, Any]:
        return {"cross_track_m": self.simulation.errors[0]}

    def _observation(self) -> _Floats:
        simulation = self.simulation
        x_m, y_m, _, yaw_rad = simulation.pose
        left, right = simulation.tread_speeds_m_s
        numbers = [*simulation.errors, *simulation.attitude_rad]
        numbers += [self.vehicle.correction_left * left, self.vehicle.correction_right * right]
        sin, cos = math.sin(yaw_rad), math.cos(yaw_rad)
        for to_x_m, to_y_m, heading_rad, _ in simulation.reference(self._preview_s).tolist():
            dx_m, dy_m = to_x_m - x_m, to_y_m - y_m
            turn_rad = math.remainder(heading_rad - yaw_rad, 2 * math.pi)
            numbers += [cos * dx_m + sin * dy_m, -sin * dx_m + cos * dy_m, turn_rad]
        return np.array(numbers, np.float32)


class Baseline:
    """A policy: one of Sidehill's controllers in the environment's place of an agent.

    It reads the simulation itself, not the observation. Call `reset()` after the environment's, then the object with
    each observation.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], kind: Kind = "icrik-mpc") -> None:
        tracking = env.unwrapped
        if not isinstance(tracking, PathTracking):
            raise ValueError(f"env: a {PathTracking.__name__} is needed, not {env!r}")
        self._env = tracking
        self._kind = kind
        self._controller: Controller | None = None
        self.decision: Decision | None = None
        """What the controller decided last."""

    def reset(self) -> None:
        """Begins an episode with a new controller for the environment's scenario."""
        self._controller = Controller(self._env.scenario, self._kind, self._env.vehicle)

    def __call__(self, observation: Any = None) -> _Floats:
        """Returns the action of this step."""
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


gymnasium.register(id="sidehill/PathTracking-v0", entry_point="sidehill.gym:PathTracking")
