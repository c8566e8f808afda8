"""What MuJoCo makes of an MJCF: run as a program it writes mjcf_reference.json, which the tests compare with."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent
ARM = """<mujoco model="arm">
 <compiler angle="degree"/>
 <default>
  <joint damping="0.3" armature="0.02" frictionloss="0.1"/>
  <default class="upper"><joint axis="0 1 0" damping="0.7"/></default>
 </default>
 <worldbody>
  <body name="stand" pos="0 0 0.3" euler="0 90 30">
   <body name="turret" pos="0 0 0.1" quat="1 0.2 0.1 0">
    <joint name="waist" axis="0 0 2" range="-90 120" pos="0.05 0.02 0" actuatorfrcrange="-20 30"/>
    <geom type="capsule" fromto="0 0 0 0 0.1 0.3" size="0.04"/>
    <body name="upper" pos="0 0 0.3" axisangle="0 1 0 20" childclass="upper">
     <joint name="shoulder" ref="10"/>
     <geom type="box" size="0.03 0.04 0.1" pos="0 0 0.1" euler="10 0 0" mass="1.2"/>
     <geom type="ellipsoid" size="0.05 0.06 0.07" pos="0 0 0.2" density="500"/>
     <geom type="cylinder" size="0.05 0.06" pos="0 0 0.2" mass="0.2" zaxis="0 1 1"/>
     <geom type="sphere" size="0.05" mass="0"/>
     <site name="tip" pos="0 0 0.25" euler="0 90 0"/>
     <body name="slider" pos="0 0 0.2" xyaxes="0 1 0 -1 0 0">
      <joint name="lift" type="slide" axis="0 0 1" range="-0.1 0.2"/>
      <inertial pos="0 0 0.05" mass="0.5" fullinertia="0.003 0.0025 0.002 0.0001 0.0002 0.0003"/>
      <body name="plate" pos="0 0 0.1">
       <inertial pos="0 0 0.05" mass="0.5" diaginertia="0.003 0.002 0.0015" euler="10 20 30"/>
      </body>
     </body>
    </body>
   </body>
  </body>
 </worldbody>
 <actuator><motor joint="shoulder" forcerange="-9 9" ctrlrange="-5 5" gear="2"/></actuator>
</mujoco>
"""
LOCKED = {"arm": {}, "fr3": {"finger_joint1": 0.02, "finger_joint2": 0.03}}


def text_of(name):
    return ARM if name == "arm" else (FOLDER / "fr3.xml").read_text()


def computed(name):
    """Positions, velocities, M and C q̇ + g of joints that are free, and damping, friction and armature."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(text_of(name))
    data, generator = mujoco.MjData(model), np.random.default_rng(3)
    joints = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)]
    free = [i for i, joint in enumerate(joints) if joint not in LOCKED[name]]
    found = {"joints": [joints[i] for i in free], "states": []}
    for attribute in ("dof_damping", "dof_frictionloss", "dof_armature"):
        found[attribute] = getattr(model, attribute)[free].tolist()
    for _ in range(4):
        data.qpos[:], data.qvel[:] = generator.uniform(-1.0, 1.0, model.nq), 0.0
        data.qvel[free] = generator.normal(size=len(free))
        for joint, value in LOCKED[name].items():
            data.qpos[joints.index(joint)] = value
        mujoco.mj_forward(model, data)
        mass_matrix = np.zeros((model.nv, model.nv))
        for column, axis in zip(mass_matrix, np.eye(model.nv), strict=True):  # mj_fullM has changed its arguments
            mujoco.mj_mulM(model, data, column, axis)
        arrays = (data.qpos[free], data.qvel[free], mass_matrix[np.ix_(free, free)], data.qfrc_bias[free])
        found["states"].append([array.tolist() for array in arrays])
    return found


if __name__ == "__main__":
    import mujoco

    content = {"mujoco": mujoco.__version__} | {name: computed(name) for name in LOCKED}
    (FOLDER / "mjcf_reference.json").write_text(json.dumps(content) + "\n")
    sys.stdout.write(f"written with MuJoCo {mujoco.__version__}\n")
