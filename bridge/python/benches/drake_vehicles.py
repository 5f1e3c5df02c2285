"""Controllers on vehicles in Drake, physics that none of them predicts with, and another engine than MuJoCo.

    pip install drake
    python bridge/python/benches/drake_vehicles.py [--realistic SEEDS]

The wheels are on tyres that give way as the springs of mujoco_vehicles.py do, on a rigid frame. A tyre touches the ground in
two points, which have the moments of an even line of its width. Each side has one motor, which drives the wheels by a rigid
chain. vehicles.py has the vehicles, and says what the table shows.

Drake's contact solver is SAP with the approximation `lagged`, with which the step hardly matters: at 10 ms turns and slides
are within 0.3 % of those at 0.6 ms. With `similar` and `sap` sliding changes normal forces, and vehicles turn less.
"""

from __future__ import annotations

import logging
import math
import sys

import numpy as np
from vehicles import GRAVITY_M_S2, SAG_M, SPRINGS_HZ, Gyroscope, Measures, main

# vehicles.py has put the examples on the path.
from body import Array

try:
    from pydrake.geometry import AddContactMaterial, HalfSpace, ProximityProperties, Sphere
    from pydrake.math import RigidTransform, RotationMatrix
    from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
    from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia, UnitInertia
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder
except ImportError:
    sys.exit("this bench needs Drake: pip install drake")

STEP_S = 0.01
# That it does not let deformable bodies touch a half space; there are none.
logging.getLogger("drake").setLevel(logging.ERROR)


def material(friction: float, stiffness_n_m: float, dissipation_s_m: float) -> ProximityProperties:
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=dissipation_s_m, point_stiffness=stiffness_n_m, friction=CoulombFriction(friction, friction),
        properties=properties,
    )  # fmt: skip
    return properties


class Vehicle(Gyroscope):
    """One of the vehicles on a slope that rises towards +Y_g: the plant of `sidehill.simulate`."""

    def __init__(self, measures: Measures, slope_deg: float) -> None:
        self.slope_rad = math.radians(slope_deg)
        self.radius_m, self.side = measures.wheel_radius_m, len(measures.axles_m)
        mass, radius = measures.mass_kg, measures.wheel_radius_m
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(time_step=STEP_S, contact_model="point", discrete_contact_approximation="lagged")
        plant, _ = AddMultibodyPlant(config, builder)
        plant.mutable_gravity_field().set_gravity_vector([0, 0, -GRAVITY_M_S2])
        slope = RigidTransform(RotationMatrix.MakeXRotation(self.slope_rad))
        # Hard: the tyres give way.
        hard = material(measures.friction, 1e12, 0.0)
        plant.RegisterCollisionGeometry(plant.world_body(), slope, HalfSpace(), "ground", hard)

        wheel_kg = 0.02 * mass
        body_kg = mass - 2 * self.side * wheel_kg
        right_m, forward_m, height_m = measures.centre_of_mass_m
        # The wheels' own mass is at their hubs, whose middle is the body's origin.
        centre_m = np.array([right_m, forward_m, height_m - radius]) * mass / body_kg
        box = UnitInertia.SolidBox(1.8 * measures.half_width_m, 1.8 * max(measures.axles_m), 0.3)
        self._body = plant.AddRigidBody("body", SpatialInertia(body_kg, centre_m, box.ShiftFromCenterOfMass(centre_m)))

        # A motor's torque is so much times what its speed lacks. Drake solves damping implicitly, and a torque not.
        self._servo_nm_s = 2000 * mass * radius**2
        disc = SpatialInertia(wheel_kg, np.zeros(3), UnitInertia.SolidCylinder(radius, measures.wheel_width_m, [1, 0, 0]))
        joints = []
        for side, right_m in (("left", -measures.half_width_m), ("right", measures.half_width_m)):
            for axle, (forward_m, share) in enumerate(zip(measures.axles_m, measures.load_shares, strict=True)):
                name = f"{side}_{axle}"
                hub = FixedOffsetFrame(f"hub_{name}", self._body.body_frame(), RigidTransform([right_m, forward_m, 0]))
                wheel = plant.AddRigidBody(f"wheel_{name}", disc)
                damping = self._servo_nm_s if axle == 0 else 0.0
                joint = RevoluteJoint(name, plant.AddFrame(hub), wheel.body_frame(), [-1, 0, 0], damping)
                joints.append(plant.AddJoint(joint))
                if axle == 0:
                    plant.AddJointActuator(name, joints[-1])
                else:
                    plant.AddCouplerConstraint(joints[-2], joints[-1], 1.0)
                load_n = 0.5 * share * mass * GRAVITY_M_S2
                tyre = material(measures.friction, load_n / SAG_M / 2, 1.4 * 2 * math.pi * SPRINGS_HZ / GRAVITY_M_S2)
                for point in (-1, 1):
                    offset = RigidTransform([point * measures.wheel_width_m / math.sqrt(12), 0, 0])
                    # Loaded, its radius is that of the wheel.
                    plant.RegisterCollisionGeometry(wheel, offset, Sphere(radius + SAG_M), f"{name}_{point}", tyre)
        plant.Finalize()
        self._plant = plant
        self._rates = [joint.velocity_start() for joint in joints]
        self._simulator = Simulator(builder.Build())
        self._context = plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())

    def reset(self, pose: tuple[float, ...], attitude: tuple[float, ...]) -> None:
        x_m, y_m, _, yaw_rad = pose
        self._simulator.get_mutable_context().SetTime(0)
        self._plant.SetPositions(self._context, self._plant.GetDefaultPositions())
        self._plant.SetVelocities(self._context, np.zeros(self._plant.num_velocities()))
        # The middle rotation is roll: equation (12).
        yaw, roll = RotationMatrix.MakeZRotation(yaw_rad), RotationMatrix.MakeYRotation(attitude[0])
        rotation = yaw @ roll @ RotationMatrix.MakeXRotation(attitude[1])
        place = RigidTransform(rotation, self._hubs_above(x_m, y_m))
        self._plant.SetFloatingBaseBodyPoseInWorldFrame(self._context, self._body, place)
        self._simulator.Initialize()
        # Until it rests on its tyres.
        self.step(0.0, 0.0, 0.5)

    def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> None:
        torques = self._servo_nm_s / self.radius_m * np.array([v_left_m_s, v_right_m_s])
        self._plant.get_actuation_input_port().FixValue(self._context, torques)
        self._simulator.AdvanceTo(self._simulator.get_context().get_time() + dt_s)

    @property
    def yaw_rate_rad_s(self) -> float:
        turning = self._plant.EvalBodySpatialVelocityInWorld(self._context, self._body).rotational()
        return float(self._rotation[:, 2] @ turning)

    @property
    def _hubs_m(self) -> Array:
        return np.asarray(self._plant.EvalBodyPoseInWorld(self._context, self._body).translation())

    @property
    def _rotation(self) -> Array:
        return np.asarray(self._plant.EvalBodyPoseInWorld(self._context, self._body).rotation().matrix())

    @property
    def _wheel_rates_rad_s(self) -> Array:
        return np.asarray(self._plant.GetVelocities(self._context)[self._rates])


if __name__ == "__main__":
    main(__doc__ or "", Vehicle)
