"""The compiled core. Names of the package `sidehill` are meant for users, the others are its own."""

import os
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeAlias, final, overload

import numpy as np
import numpy.typing as npt
from typing_extensions import Self, disjoint_base

from ._kinds import Kind
from ._plant import Plant

__version__: str

_Path = str | os.PathLike[str]
_Floats = npt.NDArray[np.float64]
_Numbers = tuple[float, ...] | list[float] | _Floats
_Array = npt.NDArray[np.floating[Any] | np.integer[Any]]
_Given = tuple[str, str | bytes]
_Maps = tuple[_Path | None, _Path | None, int | None]

@disjoint_base
class Vehicle:
    """A skid-steer vehicle as the ICR models know it; immutable, compared by its values.

    Attributes have the names of the YAML's keys (config/vehicles/j8.yaml): ICRs in m in the body frame (x right, y
    forward), slide gains in s/rad, speeds in m/s. Source: Table I of the paper.
    """

    def __new__(cls, **keys: Any) -> Vehicle:
        """Makes a vehicle of the keys that the YAML must have. Raises ValueError with key, value and range."""
    @staticmethod
    def j8() -> Vehicle:
        """Returns the Argo J8 of the paper's Table I, a rover of about one tonne with eight wheels."""
    @staticmethod
    def from_geometry(
        length_m: float,
        width_m: float,
        wheel_radius_m: float,
        mass_kg: float,
        axles: int | None = None,
        speed_m_s: float | None = None,
        name: str | None = None,
    ) -> Vehicle:
        """Returns the first guess of a vehicle from its measures, as `sidehill init` makes it.

        It is driven through the procedure of identification in simulation, on wheels with friction and with assumptions
        for the rest, which takes seconds: replace it by `identify` before you trust it on a slope.

        length_m: distance between the first and the last axle, m; of tracks their length on the ground.
        width_m: distance between the middles of the left and the right wheels or tracks, m.
        wheel_radius_m: radius of the wheels or sprockets, m.
        mass_kg: mass with payload, kg.
        axles: their number, 2 to 64, evenly spaced; 2 without it.
        speed_m_s: largest speed of the wheels, m/s; 1 without it.
        name: letters, digits, - and _; rover without it.

        Raises ValueError with argument, value and range.
        """
    def with_(self, **changes: Any) -> Vehicle:
        """Returns the vehicle with other values of some keys.

        Nested keys are given in a dict, which is merged key by key, or by names with dots:
        vehicle.with_(lambda_2_s_per_rad=2.0, **{"contact.half_width_m": 0.5}). A key of the value None is left out.
        Raises ValueError with key, value and range.
        """
    @staticmethod
    def load(path: _Path) -> Vehicle:
        """Returns the vehicle of the YAML file at `path`. Raises OSError, or ValueError with file, key, value and range."""
    @staticmethod
    def from_dict(keys: dict[str, Any]) -> Vehicle:
        """Returns the vehicle of a dict with the YAML's keys, all and no others. Raises ValueError."""
    def to_dict(self) -> dict[str, Any]:
        """Returns a dict with the YAML's keys."""
    def save(self, path: _Path) -> None:
        """Writes the vehicle to a YAML file at `path`, in place of one that is there. Raises OSError."""
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
        """c_l, from measured to effective speed of the left tread, equation (11); without unit."""
    @property
    def correction_right(self) -> float:
        """c_r, from measured to effective speed of the right tread, equation (11); without unit."""
    @property
    def contact(self) -> dict[str, Any] | None:
        """What is known of it as a vehicle on wheels, from which contact-mpc starts."""
    def __eq__(self, value: object, /) -> bool: ...
    def __copy__(self) -> Self: ...
    def __deepcopy__(self, memo: Any, /) -> Self: ...
    def _repr_html_(self) -> str: ...

@final
class Identification(Vehicle):
    """An identified vehicle, with what each stage says of it."""

    @property
    def level(self) -> dict[str, Any] | None:
        """Report of the level stage (ICRs, c_l, c_r), None without level logs.

        `estimates` (by key: value, std, half_width_95 in the key's unit, None where the logs do not tell), `segments`,
        `poses`, `j_over_n` (13), `outlier_share`, `held_out` (RMS errors of segments left out, m and rad), `warnings`,
        `undetermined` (by key: the same and `kept`, the start's value, which stays as the logs do not determine it).
        """
    @property
    def slope(self) -> dict[str, Any] | None:
        """Report of the slope stage (lambda_1, lambda_2), None without slope logs; as `level`."""
    @property
    def extension_report(self) -> dict[str, Any] | None:
        """Report of the terms beyond ICRIK, None where there were too few segments.

        `terms` (by key of the vehicle's `extension`: `verdict`, which is supported, not_told_apart, negative, out_of_range
        or not_supported, with `value` and `half_width_95`, `instead` or `reason`, and `improvement`, the fall of the
        held-out misfit as a share of it, with `improvement_half_width_95`), `segments`, `held_out` (RMS errors, m and rad,
        of `icrhk`, `icrik` and `extended`), `not_used`, why the vehicle is without them, None where it has them.
        """
    @property
    def contact_report(self) -> dict[str, Any] | None:
        """Report of the vehicle on wheels, None where it was not asked for.

        `estimates` (by key: value, interval_95, determined), `not_told_apart`, `segments`, `settled`,
        `nearer_than_geometry_alone`.
        """
    @property
    def verdict(self) -> dict[str, Any]:
        """How far to trust it.

        `max_slope_deg`: the steepest slope on which to drive with it, deg, 0 where it is not good enough to drive at
        all; `reasons`: why, a list of texts.
        """
    @property
    def text(self) -> str:
        """What `sidehill identify` prints: tables of the stages, and the verdict."""
    @property
    def notes(self) -> list[str]:
        """What reading the logs left out, and what in them looks wrong."""
    @property
    def vehicle(self) -> Vehicle:
        """The vehicle without the reports."""
    @staticmethod
    def _of(vehicle: Vehicle, report: str) -> Identification: ...

@final
class Scenario:
    """A scenario, checked with all that it names; immutable.

    Keys are those of the YAML (config/scenarios/figure_eight.yaml), where each has its unit. Names of other files are
    relative to the scenario's own, those of a dict to the working folder; they are read once. Equal are scenarios with
    equal keys and files. A pickle has the texts of all files.
    """

    def __new__(cls, **keys: Any) -> Scenario:
        """Makes a scenario of the YAML's keys, with objects and arrays in place of files.

        vehicle: a Vehicle, a dict or a file; the paper's J8 without it.
        path: array of shape (n, 2), points (x_m, y_m), or (n, 3) with z_m, smoothed as `route.smoothing` says, in place
            of `course`. One of both is needed.
        terrain: a dict as in the YAML, {"kind": "plane", "slope_deg": 8, "uphill_heading_deg": 60}, or a Grid; level
            ground without it.
        contact: for the plant contact, a dict of `vehicle` (see contact_from_geometry) and `identified` (a Vehicle).
        name, controllers, plant, seed, step_s: "scenario", ["icrik-mpc"], "icrik", 1 and 0.005 without them.

        Raises ValueError with argument, or key, value and range, OSError where a file that it names cannot be read.
        """
    @staticmethod
    def load(path: _Path) -> Scenario:
        """Returns the scenario of the YAML file at `path`. Raises OSError, or ValueError with file, key, value and range."""
    @staticmethod
    def from_dict(keys: dict[str, Any]) -> Scenario:
        """Returns the scenario of a dict with the YAML's keys. Raises ValueError, or OSError of files it names."""
    @staticmethod
    def _of_text(path: str, text: str, files: dict[_Path, str]) -> Scenario: ...
    def to_dict(self) -> dict[str, Any]:
        """Returns a dict with the YAML's keys, as they are given: what is left out has its default."""
    def with_(self, **keys: Any) -> Scenario:
        """Returns the scenario with these keys in place of its own, objects and arrays as in Scenario().

        Of `controller`, which is a dict, only what is given is replaced, and of a name with dots the one key:
        scenario.with_(seed=2, controller={"motor_lag_s": 0.1}, **{"terrain.slope_deg": 8}). Raises ValueError with key,
        value and range.
        """
    def __eq__(self, value: object, /) -> bool: ...
    def __copy__(self) -> Self: ...
    def __deepcopy__(self, memo: Any, /) -> Self: ...
    def _repr_html_(self) -> str: ...
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
    def height_m(self, x_m: npt.ArrayLike, y_m: npt.ArrayLike) -> _Floats:
        """Returns the height of the ground at places of the world, m, NaN where none is known.

        x_m, y_m: numbers or arrays whose shapes broadcast; the result has their shape. Raises ValueError naming the
        argument.
        """
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
    def learned(self) -> dict[str, tuple[float, float, float]] | None:
        """Learned parameters of the vehicle on wheels, by the keys of a vehicle's `contact`.

        (value, low, high) with the ends of the 95 % interval, in the key's unit; None of a controller that does not learn
        them.
        """
    @property
    def slip_gains(self) -> _Floats:
        """Learned slip gains, zero where they are not what is learned: array of shape (3, 5).

        Rows are v_x, v_y and omega_z, columns the terms sigma, |sigma| alpha, |sigma| phi, sigma alpha and sigma phi with
        steer sigma, roll alpha and pitch phi, in SI units with rad (docs/adaptation.md).
        """
    @property
    def model_error_m_s(self) -> float:
        """Root mean square error of the predicted velocity over the last seconds, m/s."""
    @property
    def pose_age_s(self) -> float:
        """Age of the newest pose that was believed, s."""
    @property
    def poses_gated(self) -> int:
        """Poses refused as outliers since then."""
    @property
    def poses_late(self) -> int:
        """Poses since then that came too late to have an effect."""

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
    def cross_track_bound_m(self) -> float | None:
        """Bound that the distance from the path keeps to `cross_track_m` with a probability of 95 %, m; None before there
        is an estimate."""
    @property
    def cross_track_ahead_m(self) -> float | None:
        """Distance from the path that the plan has 2 s ahead, m, left of travel positive; None where nothing is planned along
        a path."""
    @property
    def cross_track_ahead_bound_m(self) -> float | None:
        """Bound that the true distance from the path 2 s ahead keeps to `cross_track_ahead_m` with a probability of 95 %, m;
        None where that is."""
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
        """Planned (x_m, y_m, yaw_rad) at the stages' ends, the present first: array of shape (N + 1, 3).

        The present is when a command given now begins to act. None where the law makes no plan.
        """
    @property
    def plan_inputs(self) -> _Floats | None:
        """Planned effective inputs (traction_m_s, steer_m_s) of the stages: array of shape (N, 2); None as `plan`."""
    @property
    def plan_times_s(self) -> _Floats | None:
        """Ends of the stages after the plan's begin, s, 0 first: array of shape (N + 1,); None as `plan`."""

@final
class Qp:
    """The quadratic programme that an MPC solved in a control cycle, with its solution.

    minimise 1/2 x' P x + q' x subject to l <= A x <= u. Its variables are corrections of the plan before, stage by stage:
    of the state (x, y, yaw) at the stage's end, and of its inputs (traction, steer). Rows are the dynamics of all stages,
    then the limits of each stage, those of extra terms last and divided by their largest coefficient, each from above and
    from below. At the solution P x + q + A' y = 0, and multipliers y of inequalities are not negative.
    """

    @property
    def P(self) -> _Floats:
        """P, symmetric: array of shape (n, n)."""
    @property
    def q(self) -> _Floats:
        """q: array of shape (n,)."""
    @property
    def A(self) -> _Floats:
        """A, equalities first: array of shape (m, n)."""
    @property
    def l(self) -> _Floats:
        """l: array of shape (m,), -inf where only u bounds."""
    @property
    def u(self) -> _Floats:
        """u: array of shape (m,)."""
    @property
    def x(self) -> _Floats:
        """The solution: array of shape (n,)."""
    @property
    def y(self) -> _Floats:
        """Multipliers of the rows of A at the solution: array of shape (m,)."""
    @property
    def stages_A(self) -> _Floats:
        """A of each stage about the plan before, d(x, y, yaw)+ / d(x, y, yaw): array of shape (N, 3, 3)."""
    @property
    def stages_B(self) -> _Floats:
        """B of each stage, d(x, y, yaw)+ / d(traction, steer): array of shape (N, 3, 2)."""
    @property
    def stages_c(self) -> _Floats:
        """c of each stage, where its step about the plan ends less the plan's next state: array of shape (N, 3). It is zero, as
        the plan's states are those where the steps end."""

@final
class Controller:
    """Follows a scenario's path: one step() a control period.

    A copy (copy.copy) goes on bit by bit as the original does in its place: so a roll-out branches. A pickle holds the
    scenario and all that the controller was told, up to 10,000 calls; opening it repeats them. Equal are controllers of equal scenarios
    that were made alike and told the same.
    """

    def __new__(
        cls,
        scenario: Scenario,
        kind: Kind | None = None,
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
    def set_extra_terms(
        self,
        *,
        weight: npt.ArrayLike | None = None,
        target: npt.ArrayLike | None = None,
        rows: npt.ArrayLike | None = None,
        low: npt.ArrayLike | None = None,
        high: npt.ArrayLike | None = None,
    ) -> None:
        """Adds costs and constraints to the plan from the next step on, in place of those added before.

        Without arguments it removes them. z_k = (x_m, y_m, yaw_rad, traction_m_s, steer_m_s) are the planned state at the
        end of stage k, in the world, and the effective input during it: row k + 1 of `Decision.plan` and row k of
        `plan_inputs`, with a yaw that is within (-pi, pi] where the plan begins. The plan minimises the cost of tracking
        plus the sum over its N stages of (z_k - target_k)' weight_k (z_k - target_k), with low_k <= rows_k z_k <= high_k.

        weight: symmetric, positive semidefinite, in the units of the scenario's `weights`: 1/m^2 for x and y, 1/rad^2 for
            yaw, s^2/m^2 for inputs. Shape (5, 5) for all stages, or (N, 5, 5).
        target: shape (5,) or (N, 5). Differences of yaw are taken within (-pi, pi].
        rows: shape (m, 5) or (N, m, 5), m at most 8.
        low, high: fit shape (N, m); -inf and inf, as without them, for no end.

        They hold in `qp`, whose model is linear about the plan before. A step whose rows no plan meets has the status
        fallback and the reason "the QP is infeasible"; several of them stop the vehicle. So leave rows on the state open
        in the first stages, which inputs hardly change. Raises ValueError naming argument and stage, and for a kind
        without a plan; the terms in force then stay. Copies and pickles have them.
        """
    @property
    def qp(self) -> Qp | None:
        """The QP that the last step solved, with its solution; None where it solved none, and after set_extra_terms."""
    @property
    def learned_covariance(self) -> _Floats | None:
        """Covariance of what is learned, after the last step: array of shape (n, n).

        For contact-mpc of the parameters of `Estimate.learned`, in their order, with the natural logarithms of friction,
        inner_stiffness, lateral_share, slip_scale_m_s and the factors of the treads, and with the square of patch_radius_m
        in place of these; else of `Estimate.slip_gains`, row by row. None before the first readings, and of a controller
        that learns nothing (docs/adaptation.md).
        """
    @property
    def kind(self) -> Kind:
        """Name of the controller."""
    @property
    def vehicle(self) -> Vehicle:
        """The vehicle that it predicts with."""
    @property
    def period_s(self) -> float:
        """Control period, s."""
    @staticmethod
    def _repeated(
        scenario: Scenario, kind: str, vehicle: Vehicle | None, seed: int | None, calls: list[Any]
    ) -> Controller: ...
    def __eq__(self, value: object, /) -> bool: ...
    def __copy__(self) -> Controller: ...
    def __deepcopy__(self, memo: Any, /) -> Controller: ...
    def _repr_html_(self) -> str: ...

@final
class Measured:
    """What is measured in a control cycle, each reading as it came last, and the reference to follow.

    A controller of one's own in `simulate` is called with it.
    """

    @property
    def time_s(self) -> float:
        """Instant of the cycle, s."""
    @property
    def period_s(self) -> float:
        """Time until the next cycle, s."""
    @property
    def pose(self) -> tuple[float, float, float, float] | None:
        """(x_m, y_m, z_m, yaw_rad) in the world, true at pose_time_s; None before the first."""
    @property
    def pose_time_s(self) -> float | None:
        """Instant at which the pose was true, s."""
    @property
    def attitude_rad(self) -> tuple[float, float] | None:
        """(roll, pitch), rad, right side down and nose up positive; None before the first."""
    @property
    def tread_speeds_m_s(self) -> tuple[float, float] | None:
        """(left, right) as the encoders count them, before c_l and c_r, m/s; None before the first."""
    @property
    def yaw_rate_rad_s(self) -> float | None:
        """Yaw rate about the body's upward axis, rad/s, counter-clockwise positive; None without a gyroscope."""
    @property
    def cross_track_m(self) -> float | None:
        """Distance of the pose from the path, m, left of travel positive; None before there is a pose."""
    @property
    def arc_length_m(self) -> float | None:
        """Arc length of the nearest point of the path, m; None before there is a pose."""
    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, as controllers know it."""
    @overload
    def reference(self, ahead_s: float) -> tuple[float, float, float, float]:
        """Returns the reference (x_m, y_m, yaw_rad, speed_m_s) in `ahead_s` seconds; speed negative in reverse.

        Of an array of n instants it returns an array of shape (n, 4). Raises ValueError where one is negative.
        """
    @overload
    def reference(self, ahead_s: _Array | Sequence[float]) -> _Floats: ...

_Law: TypeAlias = Callable[[Measured], tuple[float, float]]

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
    def plot(self) -> Any:
        """Returns a matplotlib figure of the runs.

        It has the tracks on contours of the ground, m, cross-track error, cm, heading error, deg, commands, m/s, and of
        controllers that learn wheels with friction the coefficient with its 95 % interval. Raises ImportError without
        matplotlib (`pip install 'sidehill[plot]'`).
        """

@final
class Simulation:
    """The simulated vehicle of a scenario with the reference that it should follow, for a loop of one's own.

    The drive train is the scenario's; what is read is the truth, without its sensors. A copy (copy.copy) goes on bit by
    bit as the original does in its place: so a roll-out branches. A pickle holds the scenario and the steps, up to 10,000
    calls; opening it repeats them. Equal are simulations of equal scenarios with the same steps.
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
        """Moves on by dt_s seconds, a whole number of the scenario's steps.

        v_left_m_s, v_right_m_s: speeds told to the drives, m/s before `vehicle`'s c_l and c_r. The reference moves on with the vehicle, and waits where it is left behind.

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
    @overload
    def reference(self, ahead_s: float) -> tuple[float, float, float, float]:
        """Returns the reference (x_m, y_m, yaw_rad, speed_m_s) in `ahead_s` seconds; speed negative in reverse.

        Of an array of n instants it returns an array of shape (n, 4). Raises ValueError where one is negative.
        """
    @overload
    def reference(self, ahead_s: _Array | Sequence[float]) -> _Floats: ...
    @property
    def reference_end_s(self) -> float:
        """Time that following the reference from its start to its end takes, s."""
    @property
    def finished(self) -> bool:
        """Whether the reference has come to its end."""
    @staticmethod
    def _repeated(
        scenario: Scenario, plant: str | None, seed: int | None, calls: list[tuple[float, float, int]]
    ) -> Simulation: ...
    def __eq__(self, value: object, /) -> bool: ...
    def __copy__(self) -> Simulation: ...
    def __deepcopy__(self, memo: Any, /) -> Simulation: ...
    def _repr_html_(self) -> str: ...

def simulate(
    scenario: Scenario,
    controllers: Sequence[Kind | _Law] | Kind | _Law | None = None,
    plant: Literal["icrik", "contact"] | Plant | None = None,
    seed: int | None = None,
) -> SimulationResult:
    """Runs each controller through the scenario, one after the other.

    controllers: names, instead of the scenario's, and controllers of one's own: callables that get a Measured in every
        control cycle and return (v_left_m_s, v_right_m_s), the speeds told to the drives in what their encoders count.
        The scenario's sensors and drive train are between them and the vehicle as for the others.
    plant: icrik or contact, instead of the scenario's; or an object that is then the vehicle, see `sidehill.Plant`. What
        it gives is what the controller hears, at once: the scenario's sensors and drive train are left out.
    seed: instead of the scenario's.

    The same scenario and seed give the figures of the program `sidehill simulate` bit for bit, but for times. Raises
    ValueError naming the argument or setting; what a plant object or a callable raises comes through as it is.
    """

def drive(simulations: list[Simulation], told_m_s: _Floats | None, dt_s: _Floats, ahead_s: _Floats, threads: int) -> _Floats:
    """Drives simulations side by side; `sidehill.gym` documents it."""

def contact_from_geometry(
    length_m: float,
    width_m: float,
    wheel_radius_m: float,
    mass_kg: float,
    axles: int | None = None,
    name: str | None = None,
) -> dict[str, Any]:
    """Returns the vehicle on wheels with friction of such measures, as `sidehill init` writes it.

    It is a dict with the keys of a contact vehicle's file (config/vehicles/j8_contact.yaml), for the key `contact` of a
    scenario whose plant is contact. length_m, width_m, wheel_radius_m, mass_kg, axles and name, and errors are those of
    Vehicle.from_geometry.
    """

def linearise(
    vehicle: Vehicle,
    model: str,
    yaw_rad: _Floats,
    traction_m_s: _Floats,
    steer_m_s: _Floats,
    roll_rad: _Floats,
    pitch_rad: _Floats,
    step_s: float | None,
    smoothing_m_s: float | None,
) -> dict[str, _Floats]: ...
def figures_of_log(
    scenario: Scenario,
    time_s: _Floats,
    pose: list[_Floats],
    attitude_rad: list[_Floats],
    command_m_s: list[_Floats] | None,
) -> dict[str, Any]: ...
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
    level: list[_Given],
    slope: list[_Given],
    plant: Plant | None,
    seed: int,
    vehicle: Vehicle,
    segment_s: float,
    smoothing_s: float,
    maps: _Maps,
    contact: bool,
) -> Identification: ...
def identify_drives(logs: list[_Given], vehicle: Vehicle, maps: _Maps) -> dict[str, Any]: ...
def odometry(log: _Given, vehicle: Vehicle, maps: _Maps) -> dict[str, Any]: ...
def replay(given: dict[str, Any]) -> dict[str, Any]: ...
def report(given: dict[str, Any]) -> dict[str, Any]: ...
def route(given: dict[str, Any]) -> dict[str, Any]: ...

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
