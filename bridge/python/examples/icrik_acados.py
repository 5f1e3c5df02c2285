"""ICRIK as an acados model, and an MPC by acados' solvers beside ours.

    python bridge/python/examples/icrik_acados.py

It needs acados with its Python interface (acados_template) and CasADi. The model has the expressions of `icrik_casadi.py`.
The MPC is one real-time iteration a cycle, a QP by HPIPM about the plan before: some 40 times as fast as IPOPT there.
"""

from __future__ import annotations

import importlib
import tempfile
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import sidehill
from icrik_casadi import beside_ours, icrik, normal_of

# It has no types.
acados: Any = importlib.import_module("acados_template")


def icrik_model(vehicle: sidehill.Vehicle) -> Any:
    """Returns the AcadosModel "icrik" of a vehicle.

    x: (x_m, y_m, yaw_rad, traction_m_s, steer_m_s), where the effective speeds are held between changes.
    u: their rates of change, m/s^2.
    p: upward unit normal of the ground in the world.

    Raises ValueError for a vehicle with terms beyond ICRIK.
    """
    model = acados.AcadosModel()
    x, u, normal = ca.SX.sym("x", 5), ca.SX.sym("u", 2), ca.SX.sym("normal", 3)
    rate = ca.SX.sym("rate", 5)
    model.name = "icrik"
    model.x, model.u, model.p, model.xdot = x, u, normal, rate
    model.f_expl_expr = ca.vertcat(icrik(vehicle)(x[:3], x[3:], normal), u)
    model.f_impl_expr = rate - model.f_expl_expr
    return model


class AcadosMpc:
    """A controller for `sidehill.simulate`: one real-time iteration a cycle."""

    def __init__(self, vehicle: sidehill.Vehicle, stages: int = 25, step_s: float = 0.2) -> None:
        self.vehicle, self.stages, self.step_s = vehicle, stages, step_s
        problem = acados.AcadosOcp()
        problem.model = icrik_model(vehicle)
        problem.dims.N = stages
        problem.parameter_values = np.array([0.0, 0.0, 1.0])
        # Errors of (x, y, yaw) and the rates of the speeds.
        cost = problem.cost
        cost.cost_type, cost.cost_type_e = "LINEAR_LS", "LINEAR_LS"
        cost.W, cost.W_e = np.diag([10, 10, 0.05, 0.04, 0.04]), np.diag([10, 10, 0.05])
        cost.Vx, cost.Vu, cost.Vx_e = np.eye(5), np.zeros((5, 2)), np.eye(3, 5)
        cost.Vx[3:], cost.Vu[3:] = 0, np.eye(2)
        cost.yref, cost.yref_e = np.zeros(5), np.zeros(3)
        bounds = problem.constraints
        bounds.x0 = np.zeros(5)
        bounds.idxbx, bounds.lbx, bounds.ubx = np.array([3, 4]), -np.ones(2), np.ones(2)
        bounds.idxbu, bounds.lbu, bounds.ubu = np.array([0, 1]), np.full(2, -2.0), np.full(2, 2.0)
        options = problem.solver_options
        options.tf = stages * step_s
        options.nlp_solver_type, options.qp_solver = "SQP_RTI", "PARTIAL_CONDENSING_HPIPM"
        # The midpoint rule, as in Sidehill.
        options.integrator_type, options.hessian_approx = "ERK", "GAUSS_NEWTON"
        options.sim_method_num_stages, options.sim_method_num_steps = 2, 1
        # The compiled solver stays loaded.
        with tempfile.TemporaryDirectory() as folder:
            problem.code_export_directory = str(Path(folder) / "code")
            self.solver = acados.AcadosOcpSolver(problem, json_file=str(Path(folder) / "icrik.json"))
        self.command = np.zeros(2)
        self.started = False

    def __call__(self, measured: sidehill.Measured) -> tuple[float, float]:
        """Returns the speeds (left, right) told to the drives, m/s, for what is measured."""
        if measured.pose is None or measured.attitude_rad is None:
            return 0.0, 0.0
        x_m, y_m, _, yaw_rad = measured.pose
        reference = measured.reference(self.step_s * np.arange(self.stages + 1))[:, :3]
        # Headings that go on from the vehicle's own.
        reference[:, 2] = yaw_rad + np.unwrap(np.remainder(reference[:, 2] - yaw_rad + np.pi, 2 * np.pi) - np.pi)
        solver, state = self.solver, np.array([x_m, y_m, yaw_rad, *self.command])
        solver.set(0, "lbx", state)
        solver.set(0, "ubx", state)
        for k, target in enumerate(reference):
            last = k == self.stages
            solver.set(k, "yref", target if last else np.append(target, [0.0, 0.0]))
            solver.set(k, "p", np.array(normal_of(*measured.attitude_rad, yaw_rad)))
            if not self.started:
                solver.set(k, "x", np.append(target, [0.0, 0.0]))
        self.started = True
        solver.solve()
        # The speeds at which the first period ends.
        self.command = self.command + measured.period_s * solver.get(0, "u")
        traction, steer = self.command
        return (traction - steer) / self.vehicle.correction_left, (traction + steer) / self.vehicle.correction_right


def main() -> dict[str, float]:
    """Drives with the MPC by acados beside ours; returns their cross-track RMS, m."""
    return beside_ours(AcadosMpc)


if __name__ == "__main__":
    main()
