"""The same arm and law in Drake: the law in Python, or its own ``JointStiffnessController`` in C++."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol import MechanicalSystem
from phcontrol.compilation.rigid_body import ArmModel


def plant_of(system: MechanicalSystem, dt: float = 0.0) -> Any:
    """Return a frictionless ``MultibodyPlant`` with the inertias of a system; discrete where dt is not 0."""
    from pydrake.math import RigidTransform, RotationMatrix
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import (
        FixedOffsetFrame,
        PrismaticJoint,
        RevoluteJoint,
        RotationalInertia,
        SpatialInertia,
    )

    plant, arm, made = MultibodyPlant(dt), ArmModel(system.model), []
    for k, body in enumerate(arm.bodies):
        (a, b, c), (_, d, e), (_, _, f) = body.inertia
        inertia = SpatialInertia.MakeFromCentralInertia(
            body.mass, np.array(body.centre), RotationalInertia(a, d, f, b, c, e)
        )
        link = plant.AddRigidBody(f"b{k}", inertia)
        above = plant.world_frame() if body.parent < 0 else made[body.parent].body_frame()
        place = RigidTransform(RotationMatrix(np.array(body.rotation)), np.array(body.translation))
        frame = plant.AddFrame(FixedOffsetFrame(f"f{k}", above, place))
        kind = PrismaticJoint if body.prismatic else RevoluteJoint
        joint = plant.AddJoint(kind(f"j{k}", frame, link.body_frame(), np.array(body.axis)))
        actuator = plant.AddJointActuator(f"a{k}", joint)
        actuator.set_default_rotor_inertia(body.armature)
        actuator.set_default_gear_ratio(1.0)
        made.append(link)
    plant.mutable_gravity_field().set_gravity_vector(np.array(system.model.gravity.linear))
    plant.Finalize()
    return plant


def simulation_of(
    system: MechanicalSystem,
    goal: np.ndarray,
    stiffness: np.ndarray,
    damping: np.ndarray,
    dt: float,
    *,
    discrete: bool = False,
    law: Callable[..., np.ndarray] | None = None,
) -> Callable[[np.ndarray, np.ndarray, int], dict[str, np.ndarray]]:
    """Return a function of q0, v0 and steps that runs and logs.

    Continuous plants are integrated by the third-order Runge-Kutta method in fixed steps. A ``law`` in Python is
    sampled once a step and held; without one Drake's own controller in C++ is continuous.
    """
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
    from pydrake.systems.controllers import JointStiffnessController
    from pydrake.systems.framework import DiagramBuilder, LeafSystem
    from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, ZeroOrderHold

    n, builder = system.n, DiagramBuilder()
    plant = builder.AddSystem(plant_of(system, dt if discrete else 0.0))

    if law is None:
        controller = builder.AddSystem(JointStiffnessController(plant, stiffness, damping))
        wanted = builder.AddSystem(ConstantVectorSource(np.concatenate([goal, np.zeros(n)])))
        builder.Connect(plant.get_state_output_port(), controller.get_input_port_estimated_state())
        builder.Connect(wanted.get_output_port(), controller.get_input_port_desired_state())
        builder.Connect(controller.get_output_port(), plant.get_actuation_input_port())
    else:

        class Law(LeafSystem):
            def __init__(self) -> None:
                super().__init__()
                self.DeclareVectorInputPort("state", 2 * n)
                self.DeclareVectorOutputPort("torque", n, self._torque)

            def _torque(self, context: Any, output: Any) -> None:
                y = self.get_input_port().Eval(context)
                output.SetFromVector(law(y[:n], y[n:]))

        made, hold = builder.AddSystem(Law()), builder.AddSystem(ZeroOrderHold(dt, n))
        builder.Connect(plant.get_state_output_port(), made.get_input_port())
        builder.Connect(made.get_output_port(), hold.get_input_port())
        builder.Connect(hold.get_output_port(), plant.get_actuation_input_port())
    logger = LogVectorOutput(plant.get_state_output_port(), builder, dt)
    diagram = builder.Build()

    def run(q0: np.ndarray, v0: np.ndarray, steps: int) -> dict[str, np.ndarray]:
        simulator = Simulator(diagram)
        context = simulator.get_mutable_context()
        plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), np.concatenate([q0, v0]))
        if not discrete:
            ResetIntegratorFromFlags(simulator, "runge_kutta3", dt)
            simulator.get_mutable_integrator().set_fixed_step_mode(True)
        simulator.Initialize()
        simulator.AdvanceTo(steps * dt)
        found = logger.FindLog(context).data().T
        return {"q": found[:, :n], "v": found[:, n:]}

    return run


def step_of(
    system: MechanicalSystem, goal: np.ndarray, stiffness: np.ndarray, damping: np.ndarray
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return u = g − K_p(q − q_d) − C q̇ with g of Drake."""
    plant = plant_of(system)
    context = plant.CreateDefaultContext()

    def law(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        plant.SetPositions(context, q)
        torque: np.ndarray = -plant.CalcGravityGeneralizedForces(context) - stiffness @ (q - goal) - damping @ v
        return torque

    return law
