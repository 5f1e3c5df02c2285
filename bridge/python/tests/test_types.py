"""The stubs say what there is."""

import ast
import re
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sidehill

WHEEL = Path(__file__).parents[1]
PACKAGE = WHEEL / "python" / "sidehill"

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
controller.set_extra_terms(weight=np.eye(5), target=(0, 1, 0, 0, 0), rows=[[0, 0, 0, 1, 0]], high=0.3)
qp = controller.qp
if qp is not None:
    gap = qp.P @ qp.x + qp.q + qp.A.T @ qp.y
sidehill.campaign("campaign.yaml", runs=range(0, 10))
sidehill.identify(plant=Rover(), vehicle=vehicle, seed=2)
scenario.with_(controller=sidehill.identify_drives(["run.mcap"], vehicle, topics="topics.yaml")["controller"])
sidehill.identify(level=["log.csv"], slope=[{"time_s": [0.0]}], vehicle=vehicle, segment_s=8).save("out.yaml")
"""


def check(*arguments: object) -> None:
    """Runs a module of Python, which must find nothing."""
    done = subprocess.run([sys.executable, "-m", *map(str, arguments)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_its_use_examples_and_tests_are_typed(tmp_path: Path) -> None:
    (tmp_path / "use.py").write_text(USE)
    checked = tmp_path / "use.py", PACKAGE, *(WHEEL / "examples").glob("*.py"), *(WHEEL / "tests").glob("*.py")
    check("mypy", "--config-file", WHEEL / "pyproject.toml", "--cache-dir", tmp_path / "cache", *checked)
    check("pyright", "--project", WHEEL, "--pythonpath", sys.executable, "--level", "error", *checked)


def test_the_stub_of_the_core_is_complete() -> None:
    check("mypy.stubtest", "sidehill._sidehill", "--ignore-missing-stub")


def test_names_of_controllers_are_those_of_the_core(short: sidehill.Scenario) -> None:
    wrong: Any = "none"
    with pytest.raises(ValueError, match="they are ") as error:
        sidehill.Controller(short, wrong)
    assert str(error.value).partition("they are ")[2] == ", ".join(typing.get_args(sidehill.Kind))


def documented() -> Iterator[tuple[str, ast.FunctionDef | ast.ClassDef, str]]:
    """Public classes and functions with their methods, by the stubs and sources: (name, node, docstring)."""
    files = {PACKAGE / "_sidehill.pyi": sidehill.__all__} | {path: sidehill.__all__ for path in PACKAGE.glob("_*.py")}
    for path, names in (files | {PACKAGE / "gym.py": None, PACKAGE / "distributed.py": None}).items():
        for node in ast.parse(path.read_text()).body:
            if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
                continue
            # What the package wraps is its own in the core.
            wrapped = path.suffix == ".pyi" and not getattr(sidehill, node.name, object).__module__.endswith("sidehill")
            if (names is not None and node.name not in names) or (isinstance(node, ast.FunctionDef) and wrapped):
                continue
            of_node = ast.get_docstring(node) or ""
            yield f"{path.name}: {node.name}", node, of_node
            for member in node.body if isinstance(node, ast.ClassDef) else []:
                overload = isinstance(member, ast.FunctionDef) and "overload" in map(ast.unparse, member.decorator_list)
                if not isinstance(member, ast.FunctionDef) or (overload and not ast.get_docstring(member)):
                    continue
                if not member.name.startswith("_") or member.name in ("__new__", "__init__", "__call__"):
                    doc = of_node if member.name == "__init__" else ast.get_docstring(member) or ""
                    yield f"{path.name}: {node.name}.{member.name}", member, doc


def lacks(node: ast.FunctionDef | ast.ClassDef, doc: str) -> list[str]:
    """What a docstring does not tell: an argument, errors, a shape or a unit."""
    if not doc:
        return ["docstring"]
    if isinstance(node, ast.ClassDef):
        return []
    given = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    arguments = [name for name in given if name not in ("self", "cls")]
    found = [name for name in arguments if not re.search(rf"\b{name}\b", doc)]
    if arguments and not re.search(r"[Rr]aises|errors are those of", doc):
        found.append("errors")
    returns = ast.unparse(node.returns) if node.returns else ""
    if re.search("_Floats|_Doubles|NDArray", returns) and "shape" not in doc:
        found.append("shape")
    is_number = "property" in map(ast.unparse, node.decorator_list) and "float" in returns
    unit = r"(\b|_)(m|s|us|rad|m/s|rad/s|s/rad|m_s|rad_s)\b|without unit"
    if is_number and not re.search(r"_(m|s|us|rad|m_s|rad_s|s_per_rad)$", node.name) and not re.search(unit, doc):
        found.append("unit")
    return found


def test_every_public_name_says_what_it_is_with_shapes_units_and_errors() -> None:
    seen = {name: lacks(node, doc) for name, node, doc in documented()}
    assert len(seen) > 120
    assert {name: found for name, found in seen.items() if found} == {}


def test_a_docstring_that_lacks_something_is_found() -> None:
    source = """
def f(a, step_s):
    'Returns a.'
@property
def height(self) -> float:
    'The height.'
@property
def P(self) -> _Floats:
    'P.'
def g(): ...
"""
    found = [lacks(node, ast.get_docstring(node) or "") for node in ast.parse(source).body
             if isinstance(node, ast.FunctionDef)]  # fmt: skip
    assert found == [["step_s", "errors"], ["unit"], ["shape"], ["docstring"]]


def test_the_compiled_core_tells_it_too() -> None:
    for name in sidehill.__all__:
        each = getattr(sidehill, name)
        if not (isinstance(each, type) or callable(each)) or typing.get_origin(each):
            continue
        assert each.__doc__, name
        members = vars(each) if isinstance(each, type) else {}
        for member in (member for member in members if not member.startswith("_")):
            assert getattr(each, member).__doc__, f"{name}.{member}"
