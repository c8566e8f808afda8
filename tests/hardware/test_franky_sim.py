"""The Franka driver over libfranka's real protocol, against the simulated Research 3 of franky-sim.

Needs ``franky-sim`` and ``pylibfranka``, in an environment of their own (``.ci/run`` makes one); skipped without them.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from phcontrol import ArmError, FrankaArm, MechanicalSystem, load_robot

pytest.importorskip("pylibfranka", reason="needs pylibfranka: pip install 'phcontrol[franka]'")
franky_sim = pytest.importorskip("franky_sim", reason="needs franky-sim, which brings a simulated robot")

ROOT = Path(__file__).parents[2]
URDF = Path(franky_sim.__file__).parent / "assets" / "fr3.urdf"
FINGERS = ("fr3_finger_joint1", "fr3_finger_joint2")


@pytest.fixture
def address():
    """A simulated robot, at the address that it says."""
    server = subprocess.Popen(
        [sys.executable, "-u", "-m", "franky_sim.run_server", "--simulator", "mujoco"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        for line in server.stdout:
            found = re.search(r"using '([\d.]+)'", line)
            if found:
                time.sleep(0.5)
                yield found.group(1)
                break
        else:
            pytest.fail("the simulated robot did not start")
    finally:
        server.terminate()
        server.wait(10.0)
        server.stdout.close()


@pytest.mark.xdist_group("franka")
@pytest.mark.parametrize("law", ["energy_shaping", "total_force_rejection", "tracking", "cartesian_impedance"])
def test_a_law_runs_over_the_robots_protocol_and_nothing_aborts(address, law):
    """The example, five seconds: it ends with 1 where the robot stopped."""
    command = [sys.executable, ROOT / "examples" / "franka.py", address, "--urdf", URDF, "--law", law]
    done = subprocess.run([*command, "--seconds", "5"], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rate = int(re.search(r"largest rate \[N·m/s\]: (\d+)", done.stdout).group(1))
    assert rate <= 1000
    assert "'readings': 5500" in done.stdout
    error = re.search(r"error \[rad\]: [\d.]+ at most, ([\d.]+) at the end", done.stdout)
    if error is not None:  # dry friction of 1.1 N·m in each joint, of which the law knows nothing
        assert float(error.group(1)) < 0.2
    else:
        assert float(re.search(r"hand from its goal \[m\]: ([\d.]+)", done.stdout).group(1)) < 0.03


@pytest.mark.xdist_group("franka")
def test_the_weight_of_the_model_is_the_robots(address):
    system = MechanicalSystem(load_robot(URDF, locked_joints=FINGERS), friction=None)
    with FrankaArm(address, system) as arm:
        assert abs(arm.weight_error).max() < 0.5
        assert arm.read().torque.shape == (7,)


@pytest.mark.xdist_group("franka")
def test_no_robot_at_the_address_is_said_so():
    system = MechanicalSystem(load_robot(URDF, locked_joints=FINGERS), friction=None)
    with pytest.raises(ArmError, match="no robot answers at 127.0.0.77: libfranka: .*Is FCI activated"):
        FrankaArm("127.0.0.77", system).__enter__()
