"""Costs and constraints that are added to the MPCs' own."""

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest
import sidehill
from test_compose import SLALOM, readings

MPCS: list[Any] = ["icrik-mpc", "icrhk-mpc", "diffdrive-mpc", "contact-mpc"]
TRACTION = np.array([[0.0, 0.0, 0.0, 1.0, 0.0]])


def cycle(simulation: sidehill.Simulation, controller: sidehill.Controller) -> Any:
    """One cycle of a loop; returns its decision."""
    decision = controller.step(simulation.time_s, **readings(simulation))
    traction, steer = decision.drive_traction_m_s, decision.drive_steer_m_s
    simulation.step(traction - steer, traction + steer, controller.period_s)
    return decision


def driving(short: sidehill.Scenario, kind: Any) -> tuple[sidehill.Simulation, sidehill.Controller, Any]:
    """A vehicle under way."""
    scenario = short.with_(course=SLALOM)
    simulation, controller = sidehill.Simulation(scenario), sidehill.Controller(scenario, kind)
    decisions = [cycle(simulation, controller) for _ in range(40)]
    return simulation, controller, decisions[-1]


def stages_of(decision: Any) -> Any:
    """z of each stage of a plan."""
    return np.hstack([decision.plan[1:], decision.plan_inputs])


@pytest.mark.parametrize("kind", MPCS)
def test_a_limit_of_inputs_is_held_in_plan_and_qp(short: sidehill.Scenario, kind: Any) -> None:
    simulation, controller, before = driving(short, kind)
    largest = before.plan_inputs[:, 0].max() - 0.05
    rows_before = len(controller.qp.u) if controller.qp else 0
    controller.set_extra_terms(rows=TRACTION, high=largest)
    assert controller.qp is None
    decision = [cycle(simulation, controller) for _ in range(5)][-1]
    assert decision.status == "tracking" and decision.plan_inputs[:, 0].max() == pytest.approx(largest, abs=1e-5)
    qp: Any = controller.qp
    stages = len(decision.plan_inputs)
    assert len(qp.u) == rows_before + 2 * stages
    # The last rows of each stage: from above and from below, where there is no end.
    of_stages = np.arange(3 * stages, len(qp.u)).reshape(stages, -1)
    above, below = of_stages[:, -2], of_stages[:, -1]
    assert (qp.u[below] == 1).all() and (qp.A[below] == 0).all()
    assert (qp.y[above] > 1e-6).any() and (qp.u[above] - qp.A[above] @ qp.x > -1e-6).all()
    controller.set_extra_terms()
    last = [cycle(simulation, controller) for _ in range(5)][-1]
    assert last.plan_inputs[:, 0].max() > largest + 1e-3 and len(controller.qp.u if controller.qp else ()) == rows_before


@pytest.mark.parametrize("kind", MPCS)
def test_a_cost_is_in_the_qp_and_moves_the_plan(short: sidehill.Scenario, kind: Any) -> None:
    simulation, controller, before = driving(short, kind)
    twin = copy.copy(controller)
    stages = len(before.plan_inputs)
    random = np.random.default_rng(4)
    factor = random.uniform(-1, 1, (stages, 5, 2))
    weight = factor @ factor.transpose(0, 2, 1)
    target = stages_of(before) + random.uniform(-0.3, 0.3, (stages, 5))
    # A full turn is no difference.
    target[:, 2] += 2 * math.pi
    controller.set_extra_terms(weight=weight, target=target)
    plain, decision = (each.step(simulation.time_s, **readings(simulation)) for each in (twin, controller))
    with_, without = controller.qp, twin.qp
    assert with_ is not None and without is not None and np.array_equal(with_.A, without.A)

    # Of each stage: deviations of the state at its end, then of its inputs.
    of_stages = (slice(5 * k, 5 * k + 5) for k in range(stages))
    added = np.array([(with_.P - without.P)[own, own] for own in of_stages])
    scale = np.vdot(added, weight) / np.vdot(weight, weight)
    assert scale > 0
    np.testing.assert_allclose(added, scale * weight, atol=1e-9 * scale * weight.max())
    distance = [np.einsum("ki,kij,kj->", e, weight, e) for e in (stages_of(d) - target + [0, 0, 2 * math.pi, 0, 0]
                                                                 for d in (plain, decision))]  # fmt: skip
    assert distance[1] < distance[0]


@pytest.mark.parametrize("way", ["copy", "pickle"])
def test_copies_and_pickles_have_the_terms(short: sidehill.Scenario, way: Any) -> None:
    simulation, controller, before = driving(short, "icrik-mpc")
    plain = copy.copy(controller)
    largest = before.plan_inputs[:, 0].max() - 0.05
    controller.set_extra_terms(
        weight=np.diag([0, 0, 0, 1, 0]), target=(0, 0, 0, 0.1, 0), rows=TRACTION, low=-math.inf, high=largest
    )
    other = copy.copy(controller) if way == "copy" else pickle.loads(pickle.dumps(controller))
    assert other == controller != plain
    for _ in range(10):
        same: Any = other.step(simulation.time_s, **readings(simulation))
        own = cycle(simulation, controller)
        assert np.array_equal(own.plan, same.plan) and np.array_equal(own.plan_inputs, same.plan_inputs)
    plain.set_extra_terms()
    assert plain != controller


def test_rows_that_no_plan_meets_are_told_and_stop_the_vehicle(short: sidehill.Scenario) -> None:
    simulation, controller, _ = driving(short, "icrik-mpc")
    controller.set_extra_terms(rows=TRACTION, low=8.0)
    decisions = [cycle(simulation, controller) for _ in range(60)]
    assert all("infeasible" in decision.reason for decision in decisions)
    assert decisions[0].status == "fallback" and decisions[-1].status == "stopping"
    assert decisions[-1].traction_m_s == 0


ONE = np.eye(5)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ({"weight": ONE}, "target: weight and target are needed together"),
        ({"target": np.zeros(5)}, "weight: weight and target are needed together"),
        ({"weight": np.eye(3), "target": np.zeros(5)}, "weight: shape (3, 3), (5, 5) or ("),
        ({"weight": ONE, "target": "far"}, "target: numbers are needed, not 'far'"),
        ({"weight": ONE, "target": np.full(5, math.nan)}, "target: stage 0 has a value that is not finite"),
        ({"weight": -ONE, "target": np.zeros(5)}, "weight: stage 0 has the eigenvalue -1, and none may be negative"),
        ({"weight": np.triu(np.ones((5, 5))), "target": np.zeros(5)}, "weight: stage 0 is not symmetric"),
        ({"low": 1.0}, "rows: low and high are their ends"),
        ({"rows": TRACTION[0]}, "rows: shape (5,), (1, 5) or ("),
        ({"rows": np.ones((9, 5))}, "at most 8"),
        ({"rows": TRACTION, "low": 1.0, "high": 0.5}, "low, high: stage 0, row 0: 1 to 0.5 has no value"),
        ({"rows": TRACTION, "high": np.zeros(3)}, "high: shape (3,) does not fit ("),
    ],
)
def test_an_argument_that_is_wrong_is_named(short: sidehill.Scenario, arguments: Any, part: Any) -> None:
    controller = sidehill.Controller(short)
    same = copy.copy(controller)
    with pytest.raises(ValueError) as error:
        controller.set_extra_terms(**arguments)
    assert part in str(error.value), error.value
    assert controller == same


def test_the_stage_that_is_wrong_is_named_and_a_law_without_a_plan_refuses(short: sidehill.Scenario) -> None:
    controller = sidehill.Controller(short)
    decision: Any = driving(short, "icrik-mpc")[2]
    weight = np.zeros((len(decision.plan_inputs), 5, 5))
    weight[7, 1, 1] = -1
    with pytest.raises(ValueError, match="weight: stage 7 has the eigenvalue -1"):
        controller.set_extra_terms(weight=weight, target=np.zeros(5))
    with pytest.raises(ValueError, match="the controller makes no plan"):
        sidehill.Controller(short, "pure-pursuit").set_extra_terms(rows=TRACTION, high=0.3)
