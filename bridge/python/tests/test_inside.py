"""The inside of the MPCs: models with their derivatives, QPs with their solutions, plans."""

import csv
import math
import time
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import repository
from test_compose import SLALOM, cycle, readings

MODELS: list[Any] = ["icrik", "icrhk", "contact"]


@pytest.fixture
def states() -> Any:
    """States, inputs and attitudes away from standstill, where the models have kinks."""
    random = np.random.default_rng(3)
    state = random.uniform([-5, -5, -3], [5, 5, 3], (50, 3))
    given = random.uniform([0.2, 0.1], [0.6, 0.5], (50, 2)) * random.choice([-1, 1], (50, 2))
    attitude = random.uniform(0.02, 0.2, (50, 2)) * random.choice([-1, 1], (50, 2))
    return state, given, attitude


def turned(attitude: Any, yaw_rad: Any) -> Any:
    """The attitude of a vehicle that turns on its plane."""
    roll, pitch = attitude[..., 0], attitude[..., 1]
    # Upward normal in the body's horizontal axes, turned against the heading.
    right, forward = np.sin(roll) * np.cos(pitch), -np.sin(pitch)
    up = np.cos(roll) * np.cos(pitch)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    right, forward = cos * right + sin * forward, -sin * right + cos * forward
    return np.stack([np.arctan2(right, up), -np.arcsin(forward)], -1)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("step_s", [None, 0.1])
def test_jacobians_are_central_differences(j8: sidehill.Vehicle, states: Any, model: Any, step_s: Any) -> None:
    state, given, attitude = states

    def f(state: Any, given: Any, yaw_change: Any = 0.0) -> Any:
        return sidehill.linearise(j8, model, state, given, turned(attitude, yaw_change), step_s).f

    found = sidehill.linearise(j8, model, state, given, attitude, step_s)
    assert found.f.shape == (50, 3) and found.A.shape == (50, 3, 3) and found.B.shape == (50, 3, 2)
    np.testing.assert_allclose(
        found.f, (found.A @ state[..., None] + found.B @ given[..., None])[..., 0] + found.c, atol=1e-12
    )
    step = 1e-5
    for column in range(3):
        change = step * np.eye(3)[column]
        yaw = change[2]
        slope = (f(state + change, given, yaw) - f(state - change, given, -yaw)) / (2 * step)
        np.testing.assert_allclose(found.A[..., column], slope, atol=2e-5)
    for column in range(2):
        change = step * np.eye(2)[column]
        slope = (f(state, given + change) - f(state, given - change)) / (2 * step)
        np.testing.assert_allclose(found.B[..., column], slope, atol=2e-5)
        tilt = step * np.eye(2)[column]
        ahead = sidehill.linearise(j8, model, state, given, attitude + tilt).body_velocity
        behind = sidehill.linearise(j8, model, state, given, attitude - tilt).body_velocity
        np.testing.assert_allclose(found.body_velocity_by_attitude[..., column], (ahead - behind) / (2 * step), atol=2e-5)
        ahead = sidehill.linearise(j8, model, state, given + tilt, attitude).body_velocity
        behind = sidehill.linearise(j8, model, state, given - tilt, attitude).body_velocity
        np.testing.assert_allclose(found.body_velocity_by_input[..., column], (ahead - behind) / (2 * step), atol=2e-5)


def test_the_model_is_the_paper_s_where_nothing_is_smoothed() -> None:
    with open(repository("plant/tests/data/icrik_vectors.csv")) as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    for name in {row["vehicle"] for row in rows}:
        vehicle = sidehill.Vehicle.load(repository(f"config/vehicles/{name}.yaml"))
        own = [row for row in rows if row["vehicle"] == name]
        left, right, roll, pitch = (
            np.array([float(row[key]) for row in own]) for key in ("v_left_m_s", "v_right_m_s", "roll_rad", "pitch_rad")
        )
        turns = abs(right - left) > 1e-3
        given = np.stack([right + left, right - left], -1) / 2
        found = sidehill.linearise(
            vehicle, "icrik", np.zeros(3), given, np.stack([roll, pitch], -1), smoothing_m_s=0
        ).body_velocity
        expected = np.array([[float(row[key]) for key in ("v_x_m_s", "v_y_m_s", "omega_z_rad_s")] for row in own])
        np.testing.assert_allclose(found[turns], expected[turns], rtol=0, atol=1e-7)


def test_on_level_ground_the_rate_is_the_body_s_velocity_turned(j8: sidehill.Vehicle) -> None:
    for model in MODELS:
        found = sidehill.linearise(j8, model, [1.0, 2.0, math.pi / 2], (0.4, 0.2), (0, 0))
        v_x, v_y, omega = found.body_velocity
        # With the nose along -X_g, to the right is +Y_g.
        np.testing.assert_allclose(found.f, [-v_y, v_x, omega], atol=1e-12)
        assert found.f.shape == (3,)


def test_a_batch_is_its_elements_and_fast(j8: sidehill.Vehicle) -> None:
    random = np.random.default_rng(1)
    state, given = random.uniform(-1, 1, (40, 1, 3)), random.uniform(-0.5, 0.5, (25, 2))
    whole = sidehill.linearise(j8, "contact", state, given, (0.1, 0.05))
    assert whole.A.shape == (40, 25, 3, 3)
    for i, k in ((0, 0), (17, 3), (39, 24)):
        one = sidehill.linearise(j8, "contact", state[i, 0], given[k], (0.1, 0.05))
        assert (one.A == whole.A[i, k]).all() and (one.B == whole.B[i, k]).all() and (one.c == whole.c[i, k]).all()
    assert sidehill.linearise(j8, "icrik", np.zeros((0, 3)), (0, 0), (0, 0)).A.shape == (0, 3, 3)
    begin = time.perf_counter()
    sidehill.linearise(j8, "icrik", np.zeros((100_000, 3)), (0.3, 0.1), (0.1, 0.05))
    # A limit on hangs: it takes about 0.1 s.
    assert time.perf_counter() - begin < 20


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"model": "diffdrive"}, "model: 'diffdrive' is not a model, they are icrik, icrhk, contact"),
        ({"state": (0, 0)}, "state: shape (2,) does not end in 3: (x_m, y_m, yaw_rad)"),
        ({"input": 0.3}, "input: shape () does not end in 2"),
        ({"input": (0.3, math.inf)}, "input: inf is not finite"),
        ({"attitude": (0.0, 2.0)}, "pitch_rad"),
        ({"input": np.zeros((3, 2)), "state": np.zeros((2, 3))}, "input: traction_m_s: shape (3,) does not fit (2,)"),
        ({"step_s": 0}, "step_s: 0 is out of range"),
        ({"step_s": "fast"}, "step_s: 'fast' is not a number"),
        ({"smoothing_m_s": -1}, "smoothing_m_s: -1"),
        ({"vehicle": 3}, "vehicle: a sidehill.Vehicle is needed"),
    ],
)
def test_linearise_names_the_argument(j8: sidehill.Vehicle, change: Any, part: Any) -> None:
    arguments = {"vehicle": j8, "model": "icrik", "state": (0, 0, 0), "input": (0.3, 0), "attitude": (0, 0)}
    with pytest.raises(ValueError) as error:
        sidehill.linearise(**arguments | change)
    assert part in str(error.value), error.value


@pytest.mark.parametrize("kind", ["icrik-mpc", "icrhk-mpc", "contact-mpc"])
def test_the_qp_of_a_cycle_has_its_solution(short: sidehill.Scenario, kind: Any) -> None:
    scenario = short.with_(course=SLALOM)
    simulation, controller = sidehill.Simulation(scenario), sidehill.Controller(scenario, kind)
    assert controller.qp is None
    binding = 0
    for number in range(100):
        cycle(simulation, controller)
        qp = controller.qp
        if number % 10 or qp is None:
            continue
        n, m = len(qp.q), len(qp.u)
        assert qp.P.shape == (n, n) and qp.A.shape == (m, n) and len(qp.l) == m == len(qp.y) and len(qp.x) == n
        assert (qp.P == qp.P.T).all() and np.linalg.eigvalsh(qp.P).min() > -1e-9
        scale = 1 + max(abs(qp.q).max(), abs(qp.u).max())
        # The conditions of Karush, Kuhn and Tucker.
        np.testing.assert_allclose(qp.P @ qp.x + qp.q + qp.A.T @ qp.y, 0, atol=1e-5 * scale)
        slack = qp.u - qp.A @ qp.x
        equal = qp.l == qp.u
        assert 0 < equal.sum() < m and np.isneginf(qp.l[~equal]).all()
        np.testing.assert_allclose(slack[equal], 0, atol=1e-6 * scale)
        assert slack[~equal].min() > -1e-6 * scale and qp.y[~equal].min() > -1e-6 * scale
        np.testing.assert_allclose(slack[~equal] * qp.y[~equal], 0, atol=1e-5 * scale)
        binding += int((qp.y[~equal] > 1e-6).any())
    assert binding > 0
    assert sidehill.Controller(scenario, "pure-pursuit").qp is None


def admm(qp: Any, steps: Any = 20_000) -> Any:
    """The operator splitting of Stellato et al. (OSQP, 2020), which shares nothing with our solvers."""
    sigma, rho = 1e-6, np.where(qp.l == qp.u, 1e3, 1.0)
    system = np.linalg.inv(qp.P + sigma * np.eye(len(qp.q)) + qp.A.T @ (rho[:, None] * qp.A))
    x, z, y = np.zeros(len(qp.q)), np.zeros(len(qp.u)), np.zeros(len(qp.u))
    for _ in range(steps):
        x = system @ (sigma * x - qp.q + qp.A.T @ (rho * z - y))
        before, z = z, np.clip(qp.A @ x + y / rho, qp.l, qp.u)
        y += rho * (qp.A @ x - z)
        if max(abs(qp.A @ x - z).max(), abs(rho * (z - before)).max()) < 1e-9:
            break
    return x, y


def test_another_solver_finds_the_same_solution(short: sidehill.Scenario) -> None:
    scenario = short.with_(course=SLALOM)
    simulation, controller = sidehill.Simulation(scenario), sidehill.Controller(scenario)
    for _ in range(100):
        cycle(simulation, controller)
        qp = controller.qp
        if qp is not None and (qp.y[qp.l != qp.u] > 1e-6).sum() >= 2:
            break
    assert qp is not None
    x, y = admm(qp)
    np.testing.assert_allclose(x, qp.x, atol=1e-5)
    np.testing.assert_allclose(y, qp.y, atol=1e-3 * (1 + abs(qp.y).max()))
    assert (qp.y[qp.l != qp.u] > 1e-6).sum() >= 2


def test_what_is_learned_is_that_of_the_log(short: sidehill.Scenario) -> None:
    scenario = short.with_(plant="contact")
    (run,) = sidehill.simulate(scenario, "contact-mpc").runs
    simulation, controller = sidehill.Simulation(scenario), sidehill.Controller(scenario, "contact-mpc")
    for _ in range(40):
        cycle(simulation, controller)
    decision = controller.step(simulation.time_s, **readings(simulation))
    assert decision.estimate is not None and decision.estimate.learned is not None
    learned = decision.estimate.learned
    assert {f"learned_{key}" for key in learned} <= run.log.keys() and (decision.estimate.slip_gains == 0).all()
    for value, low, high in learned.values():
        assert low <= value <= high
    covariance = controller.learned_covariance
    assert covariance is not None and covariance.shape == (len(learned), len(learned))
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    sigmas = dict(zip(learned, np.sqrt(np.diag(covariance)), strict=True))
    _, low, high = learned["centre_of_mass_right_m"]
    np.testing.assert_allclose((high - low) / 2 / 1.96, sigmas["centre_of_mass_right_m"], rtol=1e-2)
    _, low, high = learned["friction"]
    np.testing.assert_allclose(np.log(high / low) / 2 / 1.96, sigmas["friction"], rtol=1e-2)
    icrik = sidehill.Controller(short)
    assert icrik.learned_covariance is None
    for _ in range(40):
        cycle(simulation, icrik)
    decision = icrik.step(simulation.time_s, **readings(simulation))
    assert (
        decision.estimate is not None and decision.estimate.learned is None and decision.estimate.slip_gains.shape == (3, 5)
    )
    assert (decision.estimate.slip_gains != 0).any()
    covariance = icrik.learned_covariance
    assert covariance is not None and covariance.shape == (15, 15) and (np.diag(covariance) > 0).all()
    assert sidehill.Controller(short, "diffdrive-mpc").learned_covariance is None


def test_the_stages_are_the_model_about_the_plan(short: sidehill.Scenario, j8: sidehill.Vehicle) -> None:
    scenario = short.with_(course=SLALOM)
    simulation, controller = sidehill.Simulation(scenario), sidehill.Controller(scenario, "icrhk-mpc")
    for _ in range(40):
        cycle(simulation, controller)
    decision: Any = controller.step(simulation.time_s, **readings(simulation))
    qp: Any = controller.qp
    stages = len(decision.plan_inputs)
    assert decision.plan.shape == (stages + 1, 3) and decision.plan_times_s.shape == (stages + 1,)
    assert decision.plan_times_s[0] == 0 and (np.diff(decision.plan_times_s) > 0).all()
    assert qp.stages_A.shape == (stages, 3, 3) and qp.stages_B.shape == (stages, 3, 2) and qp.stages_c.shape == (stages, 3)
    # The plan has converged, so its stages are those about the plan before; this ground is one plane.
    at = decision.plan[:-1]
    attitude = turned(np.array(simulation.attitude_rad), at[:, 2] - simulation.pose[3])
    steps = np.diff(decision.plan_times_s)
    for stage in (0, stages // 2, stages - 1):
        own = sidehill.linearise(
            j8, "icrhk", at[stage], decision.plan_inputs[stage], attitude[stage], step_s=float(steps[stage])
        )
        np.testing.assert_allclose(qp.stages_A[stage], own.A, atol=0.05)
        np.testing.assert_allclose(qp.stages_B[stage], own.B, atol=0.05)
    # The inputs planned first are the command.
    assert decision.plan_inputs[0] == pytest.approx((decision.traction_m_s, decision.steer_m_s), abs=1e-9)
