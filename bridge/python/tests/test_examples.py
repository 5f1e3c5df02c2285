"""The examples run, and what they show is so."""

import importlib
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.fixture(autouse=True)
def found(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(EXAMPLES), *sys.path])


def test_the_loop_of_ones_own():
    assert 0 < importlib.import_module("closed_loop").main() < 0.03


@pytest.mark.filterwarnings("default")
def test_the_figures_of_the_paper(tmp_path):
    pytest.importorskip("matplotlib")
    errors = importlib.import_module("paper_figures").main(tmp_path)
    assert len(errors) == 3
    for icrik, icrhk in errors.values():
        assert icrik < 0.1 and 5 * icrik < icrhk
    assert all((tmp_path / f"figure_{number}.png").stat().st_size > 20_000 for number in (2, 7))


@pytest.mark.filterwarnings("default")
def test_a_rover_in_mujoco_keeps_its_path(tmp_path):
    pytest.importorskip("mujoco")
    result = importlib.import_module("mujoco_rover").main(tmp_path)
    own, level = result.metrics["runs"]
    assert own["plant"] == "MujocoRover" and own["completed"] and level["completed"]
    # A friction that is not the model's, on another slope than the rover was identified on.
    assert own["cross_track_rms_m"] < 0.025 and own["cross_track_rms_m"] < level["cross_track_rms_m"]
    assert (tmp_path / "mujoco_rover.png").stat().st_size > 50_000


@pytest.mark.filterwarnings("default")
def test_the_gymnasium_baselines_keep_their_paths():
    pytest.importorskip("gymnasium")
    found = importlib.import_module("gym_baseline").main(episodes=2)
    for kind, episodes in found.items():
        assert all(finished for _, _, finished in episodes), kind
    # What predicts the slide of an unknown slope earns more than what does not.
    for slope, level, pursuit in zip(found["icrik-mpc"], found["icrhk-mpc"], found["pure-pursuit"], strict=True):
        assert slope[0] > level[0] > pursuit[0] and slope[1] < 0.05 and slope[1] < level[1]
