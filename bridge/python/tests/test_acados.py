"""The example in acados has the library's own model, and acados' solver drives with it."""

import importlib
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import REPOSITORY, repository
from test_casadi import compare

pytest.importorskip("acados_template")
ca = pytest.importorskip("casadi")


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(sys, "path", [str(REPOSITORY / "bridge/python/examples"), *sys.path])
    return importlib.import_module("icrik_acados")


@pytest.mark.parametrize("name", ["j8", "lazaro"])
def test_the_model_has_the_librarys_rates_and_jacobians(example: Any, name: Any) -> None:
    vehicle = sidehill.Vehicle.load(repository(f"config/vehicles/{name}.yaml"))
    model = example.icrik_model(vehicle)
    assert (model.x.shape, model.u.shape, model.p.shape) == ((5, 1), (2, 1), (3, 1))
    rates = ca.Function("rates", [model.x, model.u, model.p], [model.f_expl_expr])
    residual = ca.Function("residual", [model.xdot, model.x, model.u, model.p], [model.f_impl_expr])
    random = np.random.default_rng(5)
    state, given, change = (random.uniform(-1, 1, (200, size)) for size in (3, 2, 2))
    attitude = random.uniform(-0.3, 0.3, (200, 2))

    def icrik(_: sidehill.Vehicle) -> Any:
        """The model as that of the example in CasADi: of speeds that do not change."""
        x, u, n = ca.SX.sym("x", 3), ca.SX.sym("u", 2), ca.SX.sym("n", 3)
        return ca.Function("icrik", [x, u, n], [rates(ca.vertcat(x, u), ca.DM.zeros(2), n)[:3]])

    compare(SimpleNamespace(icrik=icrik, normal_of=example.normal_of), vehicle, state, given, attitude)
    for k in range(5):
        x, normal = np.hstack([state[k], given[k]]), example.normal_of(*attitude[k], state[k, 2])
        found = rates(x, change[k], normal)
        np.testing.assert_allclose(np.array(found)[3:, 0], change[k])
        np.testing.assert_allclose(np.array(residual(found, x, change[k], normal)), 0, atol=1e-15)


def test_acados_drives_beside_ours(example: Any) -> None:
    errors = example.main()
    assert errors["icrik-mpc"] < 0.01 and errors["AcadosMpc"] < 0.01 < errors["icrhk-mpc"] / 2
