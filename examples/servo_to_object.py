"""The PERA turns its camera to an object until it is in the middle of the image: from 30 frames a second, each late.

Writes servo_to_object.html: the camera's frustum, the object, and what the camera sees.
"""

import numpy as np

from phcontrol import (
    CameraSensor,
    HamiltonianServo,
    MechanicalSystem,
    ObservedObject,
    PinholeCamera,
    certify,
    load_robot,
    record,
    simulate,
)

system = MechanicalSystem(load_robot("pera"))
camera = PinholeCamera(focal_length=0.01, image_size=(640, 480), field_of_view=np.pi / 2)  # [m], [pixels], [rad]
thing = ObservedObject.seen_as(camera, [0.004, 0.003, 0.0028], system.at(system.robot.home))  # (mu, nu, l) [m]
controller = HamiltonianServo.tuned(system, [0.0, 0.0, 0.002], camera=camera)  # in the middle, 2 mm long
certificate = certify(controller, system)
print(certificate)

log = simulate(
    system,
    controller,
    duration=8.0,
    dt=2e-3,
    scene=thing,
    sensors=[CameraSensor(thing, rate=30.0, noise=2e-5)],  # frames a second, [m]: about a pixel
)
error = np.abs(log.features - controller.goal).max(axis=1)
print("error on the image plane [mm]: at first", 1e3 * error[0], "at the end", 1e3 * error[-1])
record(log, "servo_to_object.html")
