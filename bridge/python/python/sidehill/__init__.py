"""Path-tracking model-predictive control for skid-steer rovers on slopes.

The controller, simulation, identification and campaigns of Sidehill; the models are those of "ICR-based Kinematics for
Wheeled Skid-Steer Vehicles on Firm Slopes" (the paper). Everything is in the paper's frames: body x right, y forward, z
up; yaw of the forward axis counter-clockwise from Y_g; roll positive right side down, pitch positive nose up. Units are
in the names.
"""

from ._campaign import campaign
from ._icr import icr
from ._kinds import Kind
from ._linearise import Linearisation, linearise
from ._logs import Log, identify, identify_drives, odometry
from ._metrics import metrics
from ._plant import Plant
from ._recordings import replay, report, route
from ._scenario import Grid
from ._sidehill import (
    Controller,
    Decision,
    Estimate,
    Identification,
    Measured,
    Qp,
    Run,
    Scenario,
    Simulation,
    SimulationResult,
    Vehicle,
    __version__,
    contact_from_geometry,
    simulate,
)
from ._tune import tune

__all__ = [
    "Controller",
    "Decision",
    "Estimate",
    "Grid",
    "Identification",
    "Kind",
    "Linearisation",
    "Log",
    "Measured",
    "Plant",
    "Qp",
    "Run",
    "Scenario",
    "Simulation",
    "SimulationResult",
    "Vehicle",
    "__version__",
    "campaign",
    "contact_from_geometry",
    "icr",
    "identify",
    "identify_drives",
    "linearise",
    "metrics",
    "odometry",
    "replay",
    "report",
    "route",
    "simulate",
    "tune",
]
