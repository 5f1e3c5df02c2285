"""Path-tracking model-predictive control for skid-steer rovers on slopes.

The controller, simulation, identification and campaigns of Sidehill; the models are those of "ICR-based Kinematics for
Wheeled Skid-Steer Vehicles on Firm Slopes" (the paper). Everything is in the paper's frames: body x right, y forward, z
up; yaw of the forward axis counter-clockwise from Y_g; roll positive right side down, pitch positive nose up. Units are
in the names.
"""

from ._campaign import campaign
from ._icr import icr
from ._logs import Log, identify, odometry
from ._plant import Plant
from ._sidehill import (
    Controller,
    Decision,
    Estimate,
    Identification,
    Run,
    Scenario,
    Simulation,
    SimulationResult,
    Vehicle,
    __version__,
    simulate,
)
from ._tune import tune

__all__ = [
    "Controller",
    "Decision",
    "Estimate",
    "Identification",
    "Log",
    "Plant",
    "Run",
    "Scenario",
    "Simulation",
    "SimulationResult",
    "Vehicle",
    "__version__",
    "campaign",
    "icr",
    "identify",
    "odometry",
    "simulate",
    "tune",
]
