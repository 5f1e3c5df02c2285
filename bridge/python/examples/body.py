"""What a rover in a physics engine measures: the part of a plant for `sidehill.simulate` that needs no engine.

The model's axes are the paper's: x right, y forward, z up, so nothing is converted.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Body:
    """A rover on a plane that rises towards +Y_g. The class of an engine gives what raises here."""

    radius_m: float
    # Wheels of a side.
    side: int
    slope_rad: float

    def reset(self, pose: tuple[float, ...], attitude: tuple[float, ...]) -> None:
        """Puts the rover on the ground at (x_m, y_m, z_m, yaw_rad) with (roll_rad, pitch_rad), at rest."""
        raise NotImplementedError

    def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> None:
        """Drives for a while with the speeds that the treads are told."""
        raise NotImplementedError

    @property
    def _hubs_m(self) -> Array:
        """The middle of the wheels' hubs in the world, shape (3,)."""
        raise NotImplementedError

    @property
    def _rotation(self) -> Array:
        """From the body to the world, shape (3, 3)."""
        raise NotImplementedError

    @property
    def _wheel_rates_rad_s(self) -> Array:
        """Of the wheels, those of the left side first; positive forward."""
        raise NotImplementedError

    def _hubs_above(self, x_m: float, y_m: float) -> Array:
        """Returns where the hubs' middle is while the origin is on the ground at (x_m, y_m)."""
        normal = np.array([0, -math.sin(self.slope_rad), math.cos(self.slope_rad)])
        return np.array([x_m, y_m, y_m * math.tan(self.slope_rad)]) + self.radius_m * normal

    @property
    def pose(self) -> tuple[float, float, float, float]:
        """(x_m, y_m, z_m, yaw_rad) of the origin on the ground below the middle of the wheels."""
        rotation = self._rotation
        x_m, y_m, z_m = map(float, self._hubs_m - self.radius_m * rotation[:, 2])
        return x_m, y_m, z_m, math.atan2(rotation[1, 0], rotation[0, 0])

    @property
    def attitude_rad(self) -> tuple[float, float]:
        """(roll, pitch) from the body's upward axis, seen at its heading."""
        yaw_rad = self.pose[3]
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        up = self._rotation[:, 2]
        right, forward = cos * up[0] + sin * up[1], -sin * up[0] + cos * up[1]
        return (math.atan2(right, up[2]), -math.asin(max(-1.0, min(1.0, forward))))

    @property
    def tread_speeds_m_s(self) -> tuple[float, float]:
        """(left, right), the mean of a side's wheels."""
        turning = self._wheel_rates_rad_s * self.radius_m
        return (float(turning[: self.side].mean()), float(turning[self.side :].mean()))

    def drive(self, legs: list[tuple[float, float, float]], dt_s: float = 0.05) -> dict[str, list[float]]:
        """Drives (seconds, v_left_m_s, v_right_m_s) one after the other and returns the log as columns."""
        rows, time_s = [], 0.0
        for seconds, left, right in legs:
            for _ in range(round(seconds / dt_s)):
                rows.append((time_s, *self.tread_speeds_m_s, *self.attitude_rad, *self.pose))
                self.step(left, right, dt_s)
                time_s += dt_s
        names = ("time_s", "v_left_m_s", "v_right_m_s", "roll_rad", "pitch_rad", "x_m", "y_m", "z_m", "yaw_rad")
        return {name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
