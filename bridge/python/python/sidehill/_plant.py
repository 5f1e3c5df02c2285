"""A user's vehicle, as the core asks for it."""

from __future__ import annotations

from typing import Any, Protocol


class Plant(Protocol):
    """A vehicle for `sidehill.simulate`: any simulator behind these methods.

    After each of them, pose, attitude and measured tread speeds are asked for. They are what the method returns,
    a tuple (pose, attitude_rad, tread_speeds_m_s) or a dict with these keys; or where it returns None, attributes
    of these names. `pose` is (x_m, y_m, z_m, yaw_rad), yaw of the forward axis counter-clockwise from Y_g;
    `attitude_rad` (roll, pitch), right side down and nose up positive; `tread_speeds_m_s` (left, right) as the
    encoders measure them, m/s.
    """

    def reset(self, pose: tuple[float, float, float, float], attitude: tuple[float, float]) -> Any:
        """Puts the vehicle, at rest, to `pose` and `attitude`, where a run starts. What it raises ends the simulation."""

    def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> Any:
        """Moves on by dt_s seconds. What it raises ends the simulation.

        v_left_m_s, v_right_m_s: speeds told to the drives, m/s in what their encoders count.
        """


_PARTS = (
    ("pose", ("pose",), ("x_m", "y_m", "z_m", "yaw_rad")),
    ("attitude_rad", ("attitude_rad", "attitude"), ("roll", "pitch")),
    ("tread_speeds_m_s", ("tread_speeds_m_s", "tread_speeds"), ("left", "right")),
)


class Adapter:
    """Gives the eight numbers that the core needs after each call."""

    def __init__(self, plant: Any) -> None:
        for method in ("reset", "step"):
            if not callable(getattr(plant, method, None)):
                raise ValueError(
                    f"plant: {plant!r} has no method {method}; an object with reset(pose, attitude) and "
                    "step(v_left_m_s, v_right_m_s, dt_s), icrik or contact is needed"
                )
        self._plant = plant

    def reset(self, pose: tuple[float, ...], attitude: tuple[float, ...]) -> tuple[float, ...]:
        given = self._plant.reset(pose, attitude)
        if given is None and not any(hasattr(self._plant, name) for name in _PARTS[0][1]):
            # It tells where it is from the first step on.
            return (*pose, *attitude, 0.0, 0.0)
        return self._numbers("reset", given)

    def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> tuple[float, ...]:
        return self._numbers("step", self._plant.step(v_left_m_s, v_right_m_s, dt_s))

    def _numbers(self, method: str, given: Any) -> tuple[float, ...]:
        numbers: list[float] = []
        for index, (name, names, fields) in enumerate(_PARTS):
            part = self._part(method, given, index, names)
            try:
                values = [float(value) for value in part]
            except (TypeError, ValueError):
                values = []
            if len(values) != len(fields) or not all(abs(value) < float("inf") for value in values):
                raise ValueError(
                    f"plant: {name} after {method} must be finite numbers ({', '.join(fields)}), not {part!r}"
                )
            numbers += values
        return tuple(numbers)

    def _part(self, method: str, given: Any, index: int, names: tuple[str, ...]) -> Any:
        if isinstance(given, dict):
            for name in names:
                if name in given:
                    return given[name]
        elif given is None:
            for name in names:
                if hasattr(self._plant, name):
                    part = getattr(self._plant, name)
                    return part() if callable(part) else part
        elif isinstance(given, (tuple, list)) and len(given) == len(_PARTS):
            return given[index]
        raise ValueError(
            f"plant: {names[0]} is missing after {method}, which must return (pose, attitude_rad, tread_speeds_m_s), "
            "a dict with these keys, or None where they are attributes"
        )
