"""ICRIK as a CasADi function is the library's own model."""

import importlib
import sys
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import REPOSITORY, repository

ca = pytest.importorskip("casadi")


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(sys, "path", [str(REPOSITORY / "bridge/python/examples"), *sys.path])
    return importlib.import_module("icrik_casadi")


def compare(example: Any, vehicle: Any, state: Any, given: Any, attitude: Any, smoothing_m_s: Any = None) -> None:
    """Both models' rates and Jacobians, largest difference per kind."""
    smoothing = {} if smoothing_m_s is None else {"smoothing_m_s": smoothing_m_s}
    ours = sidehill.linearise(vehicle, "icrik", state, given, attitude, **smoothing)
    f = example.icrik(vehicle, **smoothing)
    x, u, n = ca.SX.sym("x", 3), ca.SX.sym("u", 2), ca.SX.sym("n", 3)
    rate = f(x, u, n)
    all_of = ca.Function("all", [x, u, n], [rate, ca.jacobian(rate, x), ca.jacobian(rate, u)])
    normal = np.array([example.normal_of(*angles, yaw) for angles, yaw in zip(attitude, state[:, 2], strict=True)])
    for k in range(len(state)):
        values = [np.array(each) for each in all_of(state[k], given[k], normal[k])]
        for found, expected in zip(values, (ours.f[k][:, None], ours.A[k], ours.B[k]), strict=True):
            np.testing.assert_allclose(
                found, expected, rtol=1e-9, atol=1e-10, err_msg=f"{state[k]} {given[k]} {attitude[k]}"
            )


@pytest.mark.parametrize("name", ["j8", "lazaro"])
@pytest.mark.parametrize("smoothing_m_s", [None, 0.1])
def test_rates_and_jacobians_are_the_librarys(example: Any, name: Any, smoothing_m_s: Any) -> None:
    vehicle = sidehill.Vehicle.load(repository(f"config/vehicles/{name}.yaml"))
    random = np.random.default_rng(7)
    state = random.uniform([-9, -9, -7], [9, 9, 7], (400, 3))
    # Beyond the largest speed of the identification, where the gain is 0, and at angles where ICRs reach their limits.
    given = random.uniform([-1.3, -1], [1.3, 1], (400, 2))
    attitude = random.uniform(-0.6, 0.6, (400, 2)) * random.choice([0.05, 0.3, 1], (400, 1))
    compare(example, vehicle, state, given, attitude, smoothing_m_s)


def test_at_kinks_both_take_the_same_side(example: Any, j8: sidehill.Vehicle) -> None:
    state = np.zeros((6, 3))
    given = np.array([[0, 0], [0.3, 0], [0, 0.3], [0.4, -0.2], [0.4, 0.2], [-0.4, 0.2]], float)
    for attitude in ([0, 0], [0.1, 0], [0, 0.1], [0, -0.1]):
        compare(example, j8, state, given, np.tile(np.array(attitude, float), (6, 1)))


def test_a_vehicle_with_other_terms_is_refused(example: Any) -> None:
    vehicle = sidehill.Vehicle.load(repository("config/vehicles/j8_contact_identified.yaml"))
    with pytest.raises(ValueError, match="vehicle: j8-contact-identified has an extension"):
        example.icrik(vehicle)


@pytest.mark.filterwarnings("default")
def test_the_mpc_in_casadi_drives_beside_ours(example: Any) -> None:
    errors = example.main()
    assert errors["icrik-mpc"] < errors["CasadiMpc"] < errors["icrhk-mpc"] / 2
