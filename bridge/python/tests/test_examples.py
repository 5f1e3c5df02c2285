"""The examples run, and what they show is so."""

import base64
import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
import sidehill

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.fixture(autouse=True)
def found(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(EXAMPLES), *sys.path])


def test_the_loop_of_ones_own():
    assert 0 < importlib.import_module("closed_loop").main() < 0.03


def test_the_two_commands_of_the_readmes_are_those_that_ci_runs():
    repository = EXAMPLES.parents[2]
    commands = ["pip install ./bridge/python", "python bridge/python/examples/closed_loop.py"]
    for page in ("README.md", "bridge/python/README.md", "docs/python.md"):
        lines = [line.strip() for line in (repository / page).read_text().splitlines() if line.startswith("    ")]
        at = lines.index(commands[0])
        assert lines[at : at + 2] == commands, page
    script = (repository / ".ci/python").read_text().replace('"$python" -m pip', "pip").replace('"$python"', "python")
    lines = script.replace("--quiet ", "").splitlines()
    at = lines.index(commands[0])
    assert lines[at : at + 2] == commands


@pytest.mark.filterwarnings("default")
def test_the_figures_of_the_paper(tmp_path):
    pytest.importorskip("matplotlib")
    errors = importlib.import_module("paper_figures").main(tmp_path)
    assert len(errors) == 3
    for icrik, icrhk in errors.values():
        assert icrik < 0.1 and 5 * icrik < icrhk
    assert all((tmp_path / f"figure_{number}.png").stat().st_size > 20_000 for number in (2, 7))


@pytest.mark.filterwarnings("default")
def test_an_mpc_of_ones_own_drives_beside_ours(tmp_path):
    pytest.importorskip("matplotlib")
    rows = importlib.import_module("own_mpc").main(tmp_path)
    assert len(rows) == 18 and all(row["completed"] for row in rows)
    errors = {kind: [row["cross_track_rms_m"] for row in rows if row["controller"] == kind] for kind in
              ("icrik-mpc", "OwnMpc", "pure-pursuit")}  # fmt: skip
    for ours, own, pursuit in zip(*errors.values(), strict=True):
        assert ours < 0.01 and own < 0.02 and 3 * own < pursuit
    assert (tmp_path / "own_mpc.png").stat().st_size > 40_000


@pytest.mark.filterwarnings("default")
def test_a_rover_in_mujoco_keeps_its_path(tmp_path):
    pytest.importorskip("mujoco")
    result = importlib.import_module("mujoco_rover").main(tmp_path)
    own, level = result.metrics["runs"]
    assert own["plant"] == "MujocoRover" and own["completed"] and level["completed"]
    # A friction that is not the model's, on another slope than the rover was identified on.
    assert own["cross_track_rms_m"] < 0.025 and own["cross_track_rms_m"] < level["cross_track_rms_m"]
    assert (tmp_path / "mujoco_rover.png").stat().st_size > 50_000


def test_without_a_display_and_egl_the_rover_says_that_there_is_no_picture(tmp_path):
    pytest.importorskip("mujoco")
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    code = "import mujoco_rover, pathlib; mujoco_rover.picture(None, [], pathlib.Path('none.png'))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=bare | {"MUJOCO_GL": "disable", "PYTHONPATH": str(EXAMPLES)},
        cwd=tmp_path, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0 and done.stdout.startswith("no picture: "), done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("seeds", [0, 1])
def test_contact_mpc_is_ahead_on_a_vehicle_in_mujoco(monkeypatch, seeds):
    pytest.importorskip("mujoco")
    monkeypatch.setattr(sys, "path", [str(EXAMPLES.parent / "benches"), *sys.path])
    name = "six wheels, 300 kg"
    table = importlib.import_module("mujoco_vehicles").main([name], [10.0], seeds)
    contact, _, level = table[name, 10.0][0]
    assert contact["controller"] == "contact-mpc" and contact["completed"] and level["completed"]
    assert contact["cross_track_rms_m"] < 0.5 * level["cross_track_rms_m"] < 0.05


@pytest.mark.filterwarnings("default")
def test_the_gymnasium_baselines_keep_their_paths():
    pytest.importorskip("gymnasium")
    found = importlib.import_module("gym_baseline").main(episodes=2)
    for kind, episodes in found.items():
        assert all(finished for _, _, finished in episodes), kind
    # What predicts the slide of an unknown slope earns more than what does not.
    for slope, level, pursuit in zip(found["icrik-mpc"], found["icrhk-mpc"], found["pure-pursuit"], strict=True):
        assert slope[0] > level[0] > pursuit[0] and slope[1] < 0.05 and slope[1] < level[1]


def test_rovers_whose_paths_cross_pass_each_other():
    crossing = importlib.import_module("crossing")
    fleet, nearest_m = crossing.main()
    # Corners of two rovers of 0.9 m by 0.7 m, and their wheels, are apart.
    assert nearest_m > 1.2
    for rover in fleet:
        assert rover.simulation.finished and max(map(abs, rover.errors_m)) < 0.02
    waited = [rover.waited_s for rover in fleet]
    assert waited[0] == 0 < waited[1] < waited[2]
    # As in a loop without threads, and without waiting they meet.
    again, again_m = crossing.main()
    assert again_m == nearest_m and [rover.errors_m for rover in again] == [rover.errors_m for rover in fleet]
    crossing.GIVES_WAY_M = 0.0
    assert crossing.main()[1] < 0.2


def test_the_notebook_leads_from_logs_to_a_tuned_scenario(tmp_path, monkeypatch):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    monkeypatch.setenv("SIDEHILL_REPOSITORY", str(EXAMPLES.parents[2]))
    monkeypatch.setenv("SIDEHILL_QUICK", "1")
    notebook = nbformat.read(EXAMPLES / "identify_and_tune.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "commit it without outputs"
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    printed = "".join(output.get("text", "") for output in outputs)
    assert "lambda_1_s_per_rad" in printed and "mean cost of held-out runs" in printed
    images = [output["data"]["image/png"] for output in outputs if "image/png" in output.get("data", {})]
    assert len(images) == 2
    if kept := os.environ.get("SIDEHILL_PICTURES"):
        for number, image in enumerate(images):
            (Path(kept) / f"notebook_{number}.png").write_bytes(base64.b64decode(image))
    tuned = sidehill.Scenario.load(tmp_path / "tuned" / "tuned.yaml")
    assert tuned.vehicle.name == "trento-tracks"
    # Identified, and not the guess of 1 and 0.2 s/rad.
    assert tuned.vehicle.correction_left != 1 and tuned.vehicle.lambda_1_s_per_rad != 0.2
