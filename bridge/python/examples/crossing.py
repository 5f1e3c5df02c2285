"""Three rovers on one hillside whose paths cross: each has a vehicle, a controller and a thread of its own.

    python bridge/python/examples/crossing.py

Sidehill knows one vehicle. What several owe each other is a rule of yours: here a rover that comes near one with a
smaller number stops and lets it pass. The interpreter's lock is released while the core works, so threads drive at once.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import sidehill

GIVES_WAY_M = 3.5
"""Distance to a rover with a smaller number within which one stops."""
FROM_CENTRE_M = 6.0


@dataclass
class Rover:
    """A simulated vehicle with its controller."""

    simulation: sidehill.Simulation
    controller: sidehill.Controller
    waits: bool = False
    done: bool = False
    errors_m: list[float] = field(default_factory=list)
    waited_s: float = 0.0

    def cycle(self) -> None:
        """Decides and drives for a control period."""
        simulation, period_s = self.simulation, self.controller.period_s
        time_s = simulation.time_s
        decision = self.controller.step(
            time_s,
            tread_speeds_m_s=simulation.tread_speeds_m_s,
            attitude_rad=simulation.attitude_rad,
            pose=(time_s, *simulation.pose),
        )
        traction, steer = decision.drive_traction_m_s, decision.drive_steer_m_s
        simulation.step(traction - steer, traction + steer, period_s)
        self.errors_m.append(simulation.errors[0])
        self.waited_s += period_s * self.waits
        self.done = decision.finished

    def give_way(self, gives_way: bool) -> None:
        """Stops the vehicle, or lets it drive on."""
        if gives_way and not self.waits:
            self.controller.request_stop()
        elif self.waits and not gives_way:
            self.controller.rearm()
        self.waits = gives_way


def distance_m(one: Rover, other: Rover) -> float:
    """Returns the distance of two rovers' origins."""
    return math.dist(one.simulation.pose[:2], other.simulation.pose[:2])


def rovers(slope_deg: float) -> list[Rover]:
    """Returns three rovers that drive through the centre of a plane, from three sides."""
    vehicle = sidehill.Vehicle.from_geometry(length_m=0.9, width_m=0.7, wheel_radius_m=0.15, mass_kg=120)
    made = []
    for number, bearing in enumerate(np.radians([0, 120, 240])):
        along = np.linspace(-FROM_CENTRE_M, FROM_CENTRE_M, 61)[:, None]
        scenario = sidehill.Scenario(
            path=along * [np.cos(bearing), np.sin(bearing)],
            vehicle=vehicle,
            terrain={"kind": "plane", "slope_deg": slope_deg, "uphill_heading_deg": 30},
            seed=1 + number,
        )
        made.append(Rover(sidehill.Simulation(scenario), sidehill.Controller(scenario, "icrik-mpc")))
    return made


def main(slope_deg: float = 8) -> tuple[list[Rover], float]:
    """Drives until all have arrived; returns the rovers and the smallest distance of two, m."""
    fleet = rovers(slope_deg)
    nearest_m = math.inf
    with ThreadPoolExecutor(len(fleet)) as threads:
        while not all(rover.done for rover in fleet):
            for number, rover in enumerate(fleet):
                others = (other for other in fleet[:number] if not other.done)
                rover.give_way(any(distance_m(rover, other) < GIVES_WAY_M for other in others))
                nearest_m = min([nearest_m, *(distance_m(rover, other) for other in fleet[:number])])
            # All know where the others were at the begin of the cycle, so threads change nothing in the result.
            list(threads.map(Rover.cycle, [rover for rover in fleet if not rover.done]))
    for number, rover in enumerate(fleet):
        error_m = math.sqrt(np.mean(np.square(rover.errors_m)))
        print(f"rover {number}: cross-track RMS {100 * error_m:.2f} cm, waited {rover.waited_s:.1f} s")
    print(f"smallest distance of two {nearest_m:.2f} m")
    return fleet, nearest_m


if __name__ == "__main__":
    main()
