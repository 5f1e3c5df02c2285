"""The compiled core. Names of the package `sidehill` are meant for users, the others are its own."""

import os
from typing import Any, Literal, final

import numpy as np
import numpy.typing as npt
from typing_extensions import disjoint_base

from ._plant import Plant

__version__: str

_Path = str | os.PathLike[str]
_Floats = npt.NDArray[np.float64]
_Numbers = tuple[float, ...] | list[float] | _Floats
_Text = tuple[str, bytes]

@disjoint_base
class Vehicle:
    """A skid-steer vehicle as the ICR models know it; immutable.

    Attributes have the names of the YAML's keys (config/vehicles/j8.yaml).
    """

    @staticmethod
    def load(path: _Path) -> Vehicle:
        """Returns the vehicle of a YAML file. Raises OSError, or ValueError with file, key, value and range."""
    @staticmethod
    def from_dict(keys: dict[str, Any]) -> Vehicle:
        """Returns the vehicle of a dict with the YAML's keys, all and no others. Raises ValueError."""
    def to_dict(self) -> dict[str, Any]:
        """Returns a dict with the YAML's keys."""
    def save(self, path: _Path) -> None:
        """Writes the vehicle to a YAML file, which replaces one of that name. Raises OSError."""
    @property
    def name(self) -> str:
        """Name in tables and plots."""
    @property
    def x_icr_left_m(self) -> float:
        """Left tread's ICR on level ground, m to the right of the origin, so negative."""
    @property
    def x_icr_right_m(self) -> float:
        """Right tread's ICR on level ground, m to the right of the origin."""
    @property
    def y_icr_m(self) -> float:
        """Both treads' ICR on level ground, m ahead of the origin."""
    @property
    def lambda_1_s_per_rad(self) -> float:
        """Shift of all ICRs with roll and pitch, s/rad."""
    @property
    def lambda_2_s_per_rad(self) -> float:
        """Further shift of one tread when pointing mostly up or down, s/rad."""
    @property
    def speed_max_m_s(self) -> float:
        """Largest longitudinal speed of the identification, m/s."""
    @property
    def base_half_width_m(self) -> float:
        """Half width of the rectangle of the wheels' contact points, m."""
    @property
    def base_half_length_m(self) -> float:
        """Half length of that rectangle, m."""
    @property
    def correction_left(self) -> float:
        """c_l, from measured to effective speed of the left tread, equation (11)."""
    @property
    def correction_right(self) -> float:
        """c_r, from measured to effective speed of the right tread, equation (11)."""
    @property
    def contact(self) -> dict[str, Any] | None:
        """What is known of it as a vehicle on wheels, from which contact-mpc starts."""
    def __eq__(self, value: object, /) -> bool: ...

@final
class Identification(Vehicle):
    """An identified vehicle, with what each stage says of it."""

    @property
    def level(self) -> dict[str, Any] | None:
        """Report of the level stage (ICRs, c_l, c_r), None without level logs.

        `estimates` (by key: value, std, half_width_95 in the key's unit, None where the logs do not tell), `segments`,
        `poses`, `j_over_n` (13), `outlier_share`, `held_out` (RMS errors of segments left out, m and rad), `warnings`, `undetermined` (keys that stay as they were).
        """
    @property
    def slope(self) -> dict[str, Any] | None:
        """Report of the slope stage (lambda_1, lambda_2), None without slope logs; as `level`."""
    @property
    def vehicle(self) -> Vehicle:
        """The vehicle without the reports."""

@final
class Scenario:
    """A scenario, checked with all that it names; immutable.

    Keys are those of the YAML (config/scenarios/figure_eight.yaml), where each has its unit. Names of other files are
    relative to the scenario's own, those of a dict to the working folder.
    """

    @staticmethod
    def load(path: _Path) -> Scenario:
        """Returns the scenario of a YAML file. Raises OSError, or ValueError with file, key, value and range."""
    @staticmethod
    def from_dict(keys: dict[str, Any]) -> Scenario:
        """Returns the scenario of a dict with the YAML's keys. Raises ValueError, or OSError of files it names."""
    @staticmethod
    def _of_text(path: str, text: str) -> Scenario: ...
    def to_dict(self) -> dict[str, Any]:
        """Returns a dict with the YAML's keys, as they are given: what is left out has its default."""
    def with_(self, **keys: Any) -> Scenario:
        """Returns the scenario with these keys in place of its own.

        Of `controller`, which is a dict, only what is given is replaced. Raises ValueError with key, value and range.
        """
    @property
    def name(self) -> str:
        """Name in tables and plots."""
    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, as controllers know it."""
    @property
    def controllers(self) -> list[str]:
        """Names of the scenario's controllers."""
    @property
    def plant(self) -> Literal["icrik", "contact"]:
        """What moves the vehicle."""
    @property
    def seed(self) -> int:
        """Seed of everything random."""
    @property
    def period_s(self) -> float:
        """Control period, s."""
    @property
    def step_s(self) -> float:
        """Step of the simulation, s."""
    @property
    def start_pose(self) -> tuple[float, float, float, float]:
        """Pose (x_m, y_m, z_m, yaw_rad) at which the vehicle starts."""
    @property
    def start_attitude_rad(self) -> tuple[float, float]:
        """Attitude (roll, pitch) of the ground where the vehicle starts, rad."""

@final
class Estimate:
    """The estimated state of the vehicle at the time of a cycle."""

    @property
    def time_s(self) -> float:
        """Instant it holds for, s."""
    @property
    def x_m(self) -> float:
        """Position, m."""
    @property
    def y_m(self) -> float:
        """Position, m."""
    @property
    def yaw_rad(self) -> float:
        """Heading of the forward axis, rad, counter-clockwise from Y_g."""
    @property
    def roll_rad(self) -> float:
        """Roll, rad, right side down positive."""
    @property
    def pitch_rad(self) -> float:
        """Pitch, rad, nose up positive."""
    @property
    def covariance(self) -> _Floats:
        """Covariance of (x, y, yaw): array of shape (3, 3) in m^2, m rad and rad^2."""
    @property
    def tread_speeds_m_s(self) -> tuple[float, float]:
        """Effective tread speeds (left, right), m/s."""
    @property
    def model_error_m_s(self) -> float:
        """Root mean square error of the predicted velocity over the last seconds, m/s."""
    @property
    def pose_age_s(self) -> float:
        """Age of the newest pose that was believed, s."""
    @property
    def poses_gated(self) -> int:
        """Poses refused as outliers since then."""

@final
class Decision:
    """What a control cycle decides, and what it is based on."""

    @property
    def time_s(self) -> float:
        """Instant of the cycle, s."""
    @property
    def traction_m_s(self) -> float:
        """Effective traction (V_r + V_l)/2 until the next cycle, m/s: what the treads shall do on the ground."""
    @property
    def steer_m_s(self) -> float:
        """Effective steer (V_r - V_l)/2, m/s, counter-clockwise positive."""
    @property
    def drive_traction_m_s(self) -> float:
        """Traction that the drives are told, in the speeds that their own encoders count, m/s: (11) inverted."""
    @property
    def drive_steer_m_s(self) -> float:
        """Steer that the drives are told, m/s; the left drive gets traction - steer, the right traction + steer."""
    @property
    def status(self) -> Literal["waiting", "tracking", "fallback", "stopping", "finished"]:
        """What the command is worth."""
    @property
    def reason(self) -> str | None:
        """Why the controller falls back or stops the vehicle."""
    @property
    def finished(self) -> bool:
        """Whether the reference has been followed to its end."""
    @property
    def cross_track_m(self) -> float | None:
        """Estimated distance from the path, m, left of travel positive; None before there is an estimate."""
    @property
    def arc_length_m(self) -> float | None:
        """Arc length of the nearest point of the path, m; None before there is an estimate."""
    @property
    def reference_pose(self) -> tuple[float, float, float] | None:
        """Pose (x_m, y_m, yaw_rad) of the reference; None before there is an estimate."""
    @property
    def solve_us(self) -> float:
        """Time within the QP solver, us; 0 without a QP."""
    @property
    def iterations(self) -> int:
        """Interior-point iterations; 0 where no inequality binds, and without a QP."""
    @property
    def cycle_us(self) -> float:
        """Time of the whole cycle in the controller, from readings to command, us."""
    @property
    def estimate(self) -> Estimate | None:
        """The state that the command is based on; None before there is one."""
    @property
    def plan(self) -> _Floats | None:
        """Planned (x_m, y_m, yaw_rad) at the stages' ends, the present first: array of shape (N + 1, 3)."""

@final
class Controller:
    """Follows a scenario's path: one step() a control period."""

    def __new__(
        cls,
        scenario: Scenario,
        kind: str | None = None,
        vehicle: Vehicle | None = None,
        seed: int | None = None,
    ) -> Controller:
        """Makes a controller at the start of the scenario's path.

        kind: a controller's name as in scenarios, icrik-mpc by default.
        vehicle: what it predicts with, instead of the scenario's.
        seed: instead of the scenario's.

        Raises ValueError naming the argument or setting.
        """
    def step(
        self,
        time_s: float,
        *,
        tread_speeds_m_s: _Numbers | None = None,
        attitude_rad: _Numbers | None = None,
        pose: _Numbers | None = None,
        yaw_rate_rad_s: float | None = None,
    ) -> Decision:
        """Decides on the command from now until the next cycle.

        time_s: instant of this cycle, s.
        tread_speeds_m_s: (left, right) as measured, m/s, before c_l and c_r; true at time_s.
        attitude_rad: (roll, pitch), rad, right side down and nose up positive; true at time_s.
        pose: (time_s, x_m, y_m, z_m, yaw_rad) in the world, with the instant at which it was true, which may be
            earlier; yaw counter-clockwise from Y_g.
        yaw_rate_rad_s: yaw rate about the body's upward axis, rad/s, counter-clockwise positive, as a gyroscope
            measures it; true at time_s.

        A reading is None where no new one has come. Every doubt ends in a controlled stop, which status and reason of
        the decision tell. Raises ValueError where an argument has another shape, is not finite, or an angle is beyond
        +-1.5 rad; the controller's state then stays.
        """
    def request_stop(self) -> None:
        """Stops the vehicle at its decelerations from the next cycle on, until rearm()."""
    def rearm(self) -> None:
        """Lets a stopped controller drive again, with an estimate made from nothing."""
    @property
    def kind(self) -> str:
        """Name of the controller."""
    @property
    def vehicle(self) -> Vehicle:
        """The vehicle that it predicts with."""
    @property
    def period_s(self) -> float:
        """Control period, s."""

@final
class Run:
    """One controller's run."""

    @property
    def controller(self) -> str:
        """Name of the controller."""
    @property
    def metrics(self) -> dict[str, Any]:
        """Its figures, as one entry of `sidehill simulate --format json`."""
    @property
    def log(self) -> dict[str, Any]:
        """A row a control cycle: dict of float64 arrays, with the columns of `sidehill simulate --out`.

        `status` and `reason` are lists of str. NaN where there is no estimate. Made anew at each access.
        """

@final
class SimulationResult:
    """The runs of a simulation."""

    @property
    def runs(self) -> list[Run]:
        """The runs, in the order of the controllers."""
    @property
    def metrics(self) -> dict[str, Any]:
        """The figures of all runs, {"runs": [...]}, as `sidehill simulate --format json` prints them."""

@final
class Simulation:
    """The simulated vehicle of a scenario with the reference that it should follow, for a loop of one's own.

    The drive train is the scenario's; what is read is the truth, without its sensors.
    """

    def __new__(
        cls,
        scenario: Scenario,
        plant: Literal["icrik", "contact"] | None = None,
        seed: int | None = None,
    ) -> Simulation:
        """Puts the vehicle, at rest, to the scenario's start.

        plant, seed: instead of the scenario's. Raises ValueError naming the argument or setting.
        """
    def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> None:
        """Moves on by dt_s, a whole number of the scenario's steps, with these speeds told to the drives, m/s before
        `vehicle`'s c_l and c_r. The reference moves on with the vehicle, and waits where it is left behind.

        Raises ValueError naming the argument, or where the vehicle leaves the ground that is known.
        """
    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, as controllers know it with this plant."""
    @property
    def time_s(self) -> float:
        """Time since the start, s."""
    @property
    def pose(self) -> tuple[float, float, float, float]:
        """True pose (x_m, y_m, z_m, yaw_rad)."""
    @property
    def attitude_rad(self) -> tuple[float, float]:
        """True (roll, pitch), rad."""
    @property
    def tread_speeds_m_s(self) -> tuple[float, float]:
        """(left, right) as perfect encoders count them, m/s."""
    @property
    def errors(self) -> tuple[float, float, float]:
        """(cross_track_m, along_track_m, heading_error_rad): distance from the path, left of travel positive; by how
        much the vehicle is ahead of the reference along it; heading less that of the reference."""
    def reference(self, ahead_s: float) -> tuple[float, float, float, float]:
        """Returns the reference (x_m, y_m, yaw_rad, speed_m_s) in so many seconds; speed negative in reverse."""
    @property
    def reference_end_s(self) -> float:
        """Time that following the reference from its start to its end takes, s."""
    @property
    def finished(self) -> bool:
        """Whether the reference has come to its end."""

def simulate(
    scenario: Scenario,
    controllers: list[str] | tuple[str, ...] | str | None = None,
    plant: Literal["icrik", "contact"] | Plant | None = None,
    seed: int | None = None,
) -> SimulationResult:
    """Runs each controller through the scenario, one after the other.

    controllers: names, instead of the scenario's.
    plant: icrik or contact, instead of the scenario's; or an object that is then the vehicle, see `sidehill.Plant`. What
        it gives is what the controller hears, at once: the scenario's sensors and drive train are left out.
    seed: instead of the scenario's.

    The same scenario and seed give the figures of the program `sidehill simulate` bit for bit, but for times. Raises
    ValueError naming the argument or setting; what a plant object raises comes through as it is.
    """

def icr(
    vehicle: Vehicle, roll_rad: _Floats, pitch_rad: _Floats, v_left_m_s: _Floats, v_right_m_s: _Floats
) -> dict[str, _Floats]: ...
def tune(
    campaign: _Path | dict[str, Any] | Scenario,
    controller: str,
    keys: list[str] | None,
    factor: float,
    calmness: float,
    training: int,
    held_out: int,
    tries: int,
    minutes: float,
    threads: int | None,
) -> dict[str, Any]:
    """Searches settings; `sidehill.tune` documents it."""

def identify(
    level: list[_Text],
    slope: list[_Text],
    vehicle: Vehicle,
    segment_s: float,
    smoothing_s: float,
    columns: _Path | None,
) -> Identification: ...
def odometry(log: _Text, vehicle: Vehicle, columns: _Path | None) -> dict[str, Any]: ...
@final
class Campaign:
    @staticmethod
    def read(campaign: _Path | dict[str, Any]) -> Campaign: ...
    @staticmethod
    def from_bundle(bundle: str) -> Campaign: ...
    def bundle(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def runs(self) -> int: ...
    @property
    def controllers(self) -> list[str]: ...
    @property
    def keys(self) -> list[str]: ...
    def csv(self, start: int, stop: int, threads: int | None = None) -> bytes: ...

@final
class Results:
    def __new__(cls, path: _Path, campaign: Campaign) -> Results: ...
    def missing(self, campaign: Campaign, start: int, stop: int) -> list[int]: ...
    def append(self, csv: bytes) -> None: ...
    def finish(self) -> None: ...
