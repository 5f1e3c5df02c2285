"""The stubs say what there is."""

import subprocess
import sys
from pathlib import Path

USE = """
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
sidehill.simulate(scenario, controllers=["icrik-mpc"], plant=Rover()).runs[0].log
sidehill.campaign("campaign.yaml", runs=range(0, 10))
sidehill.identify(level=["log.csv"], slope=[{"time_s": [0.0]}], vehicle=vehicle, segment_s=8).save("out.yaml")
"""


def mypy(*arguments: str) -> None:
    done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_and_a_use_of_it_are_typed(tmp_path):
    (tmp_path / "use.py").write_text(USE)
    package = Path(__file__).parents[1] / "python" / "sidehill"
    mypy("mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), str(tmp_path / "use.py"), str(package))


def test_the_stub_of_the_core_is_complete():
    mypy("mypy.stubtest", "sidehill._sidehill", "--ignore-missing-stub")
