"""The picture from above that the Gymnasium environment renders."""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from ._sidehill import Scenario, Simulation, Vehicle

PIXELS = 480


class Picture:
    """An episode seen from above, by matplotlib without a window."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, simulation: Simulation) -> None:
        try:
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.figure import Figure
        except ImportError as error:
            text = "matplotlib is needed for pictures: pip install matplotlib"
            raise gymnasium.error.DependencyNotInstalled(text) from error
        figure = Figure(figsize=(PIXELS / 100, PIXELS / 100), dpi=100, layout="constrained")
        self._canvas: Any = FigureCanvasAgg(figure)
        axes = figure.subplots()
        to_end_s = max(simulation.reference_end_s - simulation.time_s, 0.0)
        path = simulation.reference(np.linspace(0, to_end_s, 1000))[:, :2]
        width, length = vehicle.base_half_width_m, vehicle.base_half_length_m
        middle = (path.max(0) + path.min(0)) / 2
        half = float((path.max(0) - path.min(0)).max()) / 2 + 2 * math.hypot(width, length)
        x_m, y_m = (np.linspace(centre - half, centre + half, 41) for centre in middle)
        heights = np.ma.masked_invalid(scenario.height_m(*np.meshgrid(x_m, y_m)))
        if np.ptp(heights) > 1e-6:
            axes.clabel(axes.contour(x_m, y_m, heights, 8, colors="0.75", linewidths=0.8), fontsize=6)
        axes.plot(*path.T, "k--", linewidth=1)
        axes.set(xlim=x_m[[0, -1]], ylim=y_m[[0, -1]], aspect="equal", xlabel="x (m)", ylabel="y (m)")
        (self._track,) = axes.plot([], [], "tab:blue")
        (self._vehicle,) = axes.plot([], [], "tab:red")
        self._driven: list[tuple[float, float]] = []
        # The outline ends at its nose.
        right, forward = (-width, -width, width, width, 0, -width), (length, -length, -length, length, 1.3 * length, length)
        self._outline = np.array([right, forward])

    def drawn(self, simulation: Simulation) -> npt.NDArray[np.uint8]:
        """Returns the picture with the vehicle where it is now: array of shape (PIXELS, PIXELS, 3)."""
        x_m, y_m, _, yaw_rad = simulation.pose
        self._driven.append((x_m, y_m))
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        outline = np.array([[x_m], [y_m]]) + np.array([[cos, -sin], [sin, cos]]) @ self._outline
        artists: tuple[tuple[Any, Any], ...] = ((self._track, np.array(self._driven).T), (self._vehicle, outline))
        for artist, points in artists:
            artist.set_data(*points)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
