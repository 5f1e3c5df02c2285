"""The stubs say what there is."""

import subprocess
import sys
import typing
from pathlib import Path

import pytest
import sidehill

USE = """
import copy

import numpy as np
import sidehill

vehicle: sidehill.Vehicle = sidehill.Vehicle.load("j8.yaml")
scenario = sidehill.Scenario.load("scenario.yaml").with_(seed=2)
controller = sidehill.Controller(scenario, kind="icrik-mpc", vehicle=vehicle, seed=1)
decision = controller.step(0.0, tread_speeds_m_s=(0.1, 0.2), attitude_rad=np.zeros(2), pose=(0.0, 0.0, 0.0, 0.0, 0.0))
traction: float = decision.traction_m_s
class Rover:
    def reset(self, pose: tuple[float, float, float, float], attitude: tuple[float, float]) -> None: ...
    def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> None: ...
def own(measured: sidehill.Measured) -> tuple[float, float]:
    ahead = measured.reference(np.arange(3) * measured.period_s)
    return float(ahead[0, 3]), measured.reference(0.0)[3]
kind: sidehill.Kind = "contact-mpc"
result = sidehill.simulate(scenario, controllers=[kind, own], plant=Rover())
result.runs[0].log
sidehill.simulate(scenario, own)
figures: dict[str, object] = sidehill.metrics({"time_s": [0.0]}, np.zeros((3, 2)))
rover = sidehill.Vehicle.from_geometry(1.0, 0.8, 0.15, 100, axles=3).with_(lambda_2_s_per_rad=1.0)
ground = sidehill.Grid(np.arange(3), np.arange(3), lambda x, y: 0.1 * x + y)
sidehill.Scenario(path=np.zeros((3, 2)), vehicle=rover, terrain=ground).with_(seed=3)
copy.copy(controller).step(0.0)
found = sidehill.linearise(vehicle, "contact", (0, 0, 0), np.zeros(2), (0.1, 0.2), step_s=0.1)
eigenvalues = np.linalg.eigvals(found.A)
qp = controller.qp
if qp is not None:
    gap = qp.P @ qp.x + qp.q + qp.A.T @ qp.y
sidehill.campaign("campaign.yaml", runs=range(0, 10))
sidehill.identify(level=["log.csv"], slope=[{"time_s": [0.0]}], vehicle=vehicle, segment_s=8).save("out.yaml")
"""


def mypy(*arguments: str) -> None:
    done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_and_a_use_of_it_are_typed(tmp_path):
    (tmp_path / "use.py").write_text(USE)
    wheel = Path(__file__).parents[1]
    checked = (tmp_path / "use.py", wheel / "python" / "sidehill", wheel / "examples" / "own_mpc.py")
    mypy("mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), *map(str, checked))


def test_the_stub_of_the_core_is_complete():
    mypy("mypy.stubtest", "sidehill._sidehill", "--ignore-missing-stub")


def test_names_of_controllers_are_those_of_the_core(short):
    with pytest.raises(ValueError, match="they are ") as error:
        sidehill.Controller(short, "none")
    assert str(error.value).partition("they are ")[2] == ", ".join(typing.get_args(sidehill.Kind))


def test_every_public_name_says_what_it_is():
    for name in sidehill.__all__:
        each = getattr(sidehill, name)
        if not (isinstance(each, type) or callable(each)) or typing.get_origin(each):
            continue
        assert each.__doc__, name
        members = vars(each) if isinstance(each, type) else {}
        for member in (member for member in members if not member.startswith("_")):
            assert getattr(each, member).__doc__, f"{name}.{member}"
