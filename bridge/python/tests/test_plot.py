"""Plots of results."""

import sys
from pathlib import Path

import numpy as np
import pytest
import sidehill


@pytest.mark.filterwarnings("default")
def test_a_plot_shows_the_logs_on_their_ground(short: sidehill.Scenario, tmp_path: Path) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    result = sidehill.simulate(short, ["contact-mpc", "pure-pursuit"], plant="contact")
    figure = result.plot()
    figure.savefig(tmp_path / "runs.png")
    assert (tmp_path / "runs.png").stat().st_size > 40_000
    axes = {axis.get_ylabel(): axis for axis in figure.axes}
    for run, line in zip(result.runs, axes["cross-track, cm"].lines, strict=True):
        assert line.get_label() == run.controller
        np.testing.assert_array_equal(line.get_ydata(), 100 * run.log["cross_track_m"])
    assert {"heading error, deg", "traction, m/s", "steer, m/s", "learned friction", "y, m"} <= axes.keys()
    ground = axes["y, m"]
    assert len(ground.lines) == 3 and ground.collections, "tracks, reference and contours"
    # Without a law that learns wheels there is nothing to show of them; level ground has no contours.
    level = sidehill.simulate(short.with_(terrain={"kind": "level"}), "pure-pursuit").plot()
    assert "learned friction" not in {axis.get_ylabel() for axis in level.axes}
    matplotlib.pyplot.close("all")


def test_without_matplotlib_a_plot_says_what_it_needs(short: sidehill.Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    result = sidehill.simulate(short, "pure-pursuit")
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ImportError, match="pip install matplotlib"):
        result.plot()


def test_the_height_of_the_ground(short: sidehill.Scenario) -> None:
    slope = np.tan(np.radians(8))
    x, y = np.meshgrid([0.0, 1.0], [0.0, 2.0, 3.0])
    up = np.radians(60)
    expected = slope * (-np.sin(up) * x + np.cos(up) * y)
    height = short.height_m(x, y)
    np.testing.assert_allclose(height - height[0, 0], expected, atol=1e-12)
    assert short.height_m(1, 2).shape == ()
    known = short.with_(terrain=sidehill.Grid([-9.0, 0, 9], [-9.0, 0, 9], np.ones((3, 3))))
    np.testing.assert_array_equal(known.height_m([0, 100], 0), [1, np.nan])
    with pytest.raises(ValueError, match="y_m: numbers are needed"):
        short.height_m(0, "north")
