"""Plots of runs, by matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._sidehill import Scenario, SimulationResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CONTOURS = 120
"""Points of the ground along each side of the map."""
MARGIN_M = 1.0
"""Ground around the tracks that is drawn, m."""


def plot(result: SimulationResult, scenario: Scenario) -> Figure:
    """Returns a figure of the runs: `SimulationResult.plot` documents it."""
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise ImportError("plots need matplotlib: pip install 'sidehill[plot]', or pip install matplotlib") from None
    logs = {run.controller: run.log for run in result.runs}
    learned = {name: log for name, log in logs.items() if "learned_friction" in log}
    rows: list[Any] = [["map", "cross"], ["map", "heading"], ["map", "traction"], ["map", "steer"]]
    figure: Figure
    figure, axes = plt.subplot_mosaic(
        rows + ([["map", "learned"]] if learned else []),
        figsize=(12, 8),
        layout="constrained",
        width_ratios=[1.2, 1],
    )
    _map(axes["map"], logs, scenario)
    for panel, column, scale, label in (
        ("cross", "cross_track_m", 100.0, "cross-track, cm"),
        ("heading", "heading_error_rad", 180 / np.pi, "heading error, deg"),
        ("traction", "command_traction_m_s", 1.0, "traction, m/s"),
        ("steer", "command_steer_m_s", 1.0, "steer, m/s"),
    ):
        for name, log in logs.items():
            axes[panel].plot(log["time_s"], scale * log[column], label=name)
        axes[panel].set_ylabel(label)
        axes[panel].grid(alpha=0.3)
    for name, log in learned.items():
        _learned(axes["learned"], name, log)
    bottom = axes["learned" if learned else "steer"]
    bottom.set_xlabel("time, s")
    return figure


def _map(axes: Axes, logs: dict[str, dict[str, Any]], scenario: Scenario) -> None:
    """Draws the tracks and the reference on contours of the ground."""
    first = next(iter(logs.values()))
    tracks = [(first["reference_x_m"], first["reference_y_m"]), *((log["x_m"], log["y_m"]) for log in logs.values())]
    sides = []
    for values in zip(*tracks, strict=True):
        both = np.concatenate(values)
        sides.append(np.linspace(np.nanmin(both) - MARGIN_M, np.nanmax(both) + MARGIN_M, CONTOURS))
    height = scenario.height_m(*np.meshgrid(*sides))
    if np.nanmax(height) - np.nanmin(height) > 1e-6:
        lines = axes.contour(*sides, height, levels=12, colors="0.7", linewidths=0.8, linestyles="solid")
        axes.clabel(lines, fmt="%.1f m", fontsize=7)
    axes.plot(*tracks[0], "k--", linewidth=1, label="reference")
    for name, (x, y) in zip(logs, tracks[1:], strict=True):
        axes.plot(x, y, label=name)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.set_title(scenario.name)
    axes.legend()


def _learned(axes: Axes, name: str, log: dict[str, Any]) -> None:
    """Draws the friction that a controller learns, with its 95 % interval."""
    (line,) = axes.plot(log["time_s"], log["learned_friction"], label=name)
    axes.fill_between(
        log["time_s"], log["learned_friction_low"], log["learned_friction_high"], color=line.get_color(), alpha=0.2
    )
    axes.set_ylabel("learned friction")
    axes.grid(alpha=0.3)
