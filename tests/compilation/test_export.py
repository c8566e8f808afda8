"""An exported law is built and run by itself, from an empty folder."""

from __future__ import annotations

import dataclasses
import re
import shutil
import subprocess

import numpy as np
import pytest
from scipy.optimize import minimize
from typer.testing import CliRunner

from phcontrol import (
    CompilationError,
    Controller,
    ExternalAction,
    ForceRegulation,
    ImpedanceGrasping,
    Measured,
    MechanicalSystem,
    load_robot,
    make_controller,
    with_tank,
)
from phcontrol.cli import app
from phcontrol.compilation.export import export_law
from phcontrol.controllers.command import Command
from tests.conftest import make_system

STRICT = ["-Wall", "-Wextra", "-Werror"]
SANITIZED = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def build(folder, compiler, *options, program="replay"):
    command = [*compiler, *STRICT, *options, "law.c", "main.c", "-o", program, "-lm"]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return folder / program


def run(program):
    return subprocess.run([str(program)], capture_output=True, text=True, check=False)


def check(folder, compiler, tolerance):
    """Build as C99 with sanitizers and as C++, and replay the recorded cases both ways."""
    for program in (
        build(folder, [compiler.path], "-O1", "-std=c99", *SANITIZED),
        build(folder, [compiler.path, "-x", "c++"], "-O1", "-std=c++11", program="replay_cpp"),
    ):
        result = run(program)
        assert result.returncode == 0, result.stdout + result.stderr
        (difference,) = re.findall(r"24 cases, largest relative difference ([\d.e+-]+)", result.stdout)
        assert float(difference) <= tolerance


@pytest.mark.parametrize(("name", "single"), [("force_feedback_measured", False), ("energy_shaping", True)])
def test_a_law_of_two_joints(name, single, shoulder, compiler, tmp_path):
    exported = export_law(make_controller(name, shoulder), tmp_path / "law", single=single)
    assert exported.difference <= 1e-12
    assert sorted(path.name for path in exported.files) == ["CMakeLists.txt", "README.md", "law.c", "law.h", "main.c"]
    source = (tmp_path / "law" / "law.c").read_text()
    assert not re.search(r"\b(malloc|calloc|free|double)\b" if single else r"\b(malloc|calloc|free|float)\b",
                         source.replace("(double)dt", "").replace("const double now", ""))  # fmt: skip
    check(tmp_path / "law", compiler, 1e-4 if single else 1e-12)


def test_a_law_with_a_tank(shoulder, compiler, tmp_path):
    """The tank's level is part of the law's state, and moves with each step."""
    action = ExternalAction(lambda t, x: 0.5 * np.cos(x.position + t), duration=1.0)
    law = with_tank(ImpedanceGrasping).tuned(shoulder, actions=action, regulation=ForceRegulation([1.0, -1.0]))
    exported = export_law(law, tmp_path / "law")
    assert exported.difference <= 1e-12
    assert f"#define LAW_STATES {law.state_size} " in (tmp_path / "law" / "law.h").read_text()
    check(tmp_path / "law", compiler, 1e-12)


def test_a_servo_goes_on_through_a_singular_posture(compiler, tmp_path):
    """Where it stopped: at rest in the middle of what is damped, and where its image Jacobian has no rank."""
    system = make_system("pera_shoulder_elbow")
    law = make_controller("hamiltonian_servo", system)
    export_law(law, tmp_path / "law")
    features = law.goal + np.array([1e-4, -2e-4, 1e-4])

    def distance(q):
        B = law.view(system.at(q), features).image_jacobian
        return law.damping_of_singularities.distance(B @ B.T) / law.singular_region

    options = {"maxiter": 1500, "fatol": 1e-10, "xatol": 1e-10}
    generator = np.random.default_rng(0)
    starts = [system.robot.random_position(generator) for _ in range(5)]
    q = min(
        (minimize(distance, start, method="Nelder-Mead", options=options) for start in starts), key=lambda r: r.fun
    ).x
    assert distance(q) < 1e-5
    torque = law.evaluate(0.0, system.at(q), np.zeros(0), Measured(features=features)).torque

    def numbers(values):
        return ", ".join(repr(float(value)) for value in values)

    (tmp_path / "law" / "main.c").write_text(
        f"""
#include "law.h"
#include <stdio.h>
int main(void) {{
  law_state self;
  const law_real q[] = {{{numbers(q)}}}, v[LAW_JOINTS] = {{0}}, seen[] = {{{numbers(features)}}};
  law_real torque[LAW_JOINTS];
  law_init(&self);
  if (law_step(&self, q, v, seen, 0.001, torque) != LAW_OK) return 1;
  for (int i = 0; i < LAW_JOINTS; i++) printf("%.17g ", torque[i]);
  return 0;
}}
"""
    )
    result = run(build(tmp_path / "law", [compiler.path], "-std=c99", *SANITIZED))
    assert result.returncode == 0, result.stderr
    np.testing.assert_allclose(np.array(result.stdout.split(), dtype=float), torque, rtol=1e-9, atol=1e-9)


@pytest.mark.study
@pytest.mark.parametrize(
    "name", ["force_feedback", "tracking", "hamiltonian_servo", "cartesian_impedance", "cartesian_tracking"]
)
@pytest.mark.parametrize("single", [False, True])
def test_laws_of_the_panda_by_the_command_and_cmake(name, single, compiler, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    locked = ["--lock", "panda_finger_joint1", "--lock", "panda_finger_joint2"]
    arguments = ["export", "--controller", name, "--robot", "panda", *locked, "--out", "law"]
    result = CliRunner().invoke(app, arguments + (["--float"] if single else []))
    assert result.exit_code == 0, result.output
    check(tmp_path / "law", compiler, 1e-4 if single else 1e-12)
    if shutil.which("cmake") is None:
        pytest.skip("no cmake")
    for command in (["cmake", "-B", "build"], ["cmake", "--build", "build"], ["ctest", "--test-dir", "build"]):
        done = subprocess.run(command, cwd=tmp_path / "law", capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_replay_finds_a_law_that_is_wrong_by_one_part_in_a_million(shoulder, compiler, tmp_path):
    export_law(make_controller("energy_shaping", shoulder), tmp_path / "law")
    source = tmp_path / "law" / "law.c"
    text = source.read_text()
    spoiled = text.replace("torque[i] = out[i];", "torque[i] = out[i] * 1.000001;")
    assert spoiled != text
    source.write_text(spoiled)
    assert run(build(tmp_path / "law", [compiler.path], "-std=c99")).returncode == 1


def test_a_branch_that_is_not_compiled_stops_the_arm(compiler, tmp_path):
    """An object behind the camera: the status says so, gravity is compensated, and motion damped."""
    system = make_system("pera_shoulder_elbow")
    export_law(make_controller("hamiltonian_servo", system), tmp_path / "law")
    (tmp_path / "law" / "main.c").write_text(
        """
#include "law.h"
#include <math.h>
#include <stdio.h>
int main(void) {
  law_state self;
  law_real q[LAW_JOINTS] = {0}, v[LAW_JOINTS] = {0}, seen[3] = {0, 0, (law_real)-0.002};
  law_real torque[LAW_JOINTS], moving[LAW_JOINTS], gravity[LAW_JOINTS];
  q[0] = 0.3; q[1] = 0.5; q[2] = 1.0;
  law_init(&self);
  if (law_step(&self, q, v, seen, 0.001, torque) != LAW_STOPPED) return 1;
  law_gravity(q, gravity);
  for (int i = 0; i < LAW_JOINTS; i++)
    if (fabs(torque[i] - gravity[i]) > 1e-12) return 2;
  for (int k = 0; k < LAW_JOINTS; k++) v[k] = 0.1 * (k + 1);
  if (law_step(&self, q, v, seen, 0.001, moving) != LAW_STOPPED) return 3;
  double power = 0.0;
  for (int i = 0; i < LAW_JOINTS; i++) power += v[i] * (moving[i] - gravity[i]);
  return power < 0.0 ? 0 : 4;
}
"""
    )
    assert run(build(tmp_path / "law", [compiler.path], "-std=c99", *SANITIZED)).returncode == 0


def test_the_command_says_what_it_refuses(tmp_path):
    result = CliRunner().invoke(app, ["export", "--controller", "energy_shapping", "--out", str(tmp_path / "law")])
    assert result.exit_code == 2
    assert "Did you mean 'energy_shaping'?" in result.stderr
    assert not (tmp_path / "law").exists()


def test_the_doctor_says_what_is_there_and_what_is_missing(monkeypatch, tmp_path):
    monkeypatch.setenv("PHCONTROL_CACHE", str(tmp_path / "cache"))
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    assert re.search(r"^C compiler +\S+: \S", result.stdout, re.MULTILINE)
    assert f"{tmp_path / 'cache'}: empty" in result.stdout
    monkeypatch.setenv("CC", "no-such-compiler")
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    assert "missing: a C compiler" in result.stdout
    assert "refused, others may use it" in result.stdout


def test_a_name_does_not_become_code(compiler, tmp_path):
    robot = dataclasses.replace(load_robot("pera_shoulder"), name="arm */ \n#error planted /*")
    system = MechanicalSystem(robot)
    export_law(make_controller("energy_shaping", system), tmp_path / "law")
    check(tmp_path / "law", compiler, 1e-12)


class Integral(Controller):
    """A spring and a state that the measured force moves; it begins where ``first`` says."""

    name = "integral"
    needs = ("external_force",)
    states = ("own",)
    first = staticmethod(lambda x: np.zeros(2))

    def storage(self, t, x, state, measured=None):
        return x.kinetic_energy

    def target(self, t, x, state, measured=None):
        raise NotImplementedError

    def initial_state(self, x):
        return self.first(x)

    def evaluate(self, t, x, state, measured=None):
        spring = x.system.motor_torque(x.potential_gradient) - 3.0 * x.position - 2.0 * x.velocity
        return Command(spring + np.clip(measured.external_force, -5.0, 5.0) - 0.1 * state, 1.0 * x.position)


def test_what_is_not_finite_gives_no_torque(shoulder, compiler, tmp_path):
    """Measured numbers and the law's own state are looked at too, and so is the torque that stops the arm."""
    export_law(Integral(shoulder), tmp_path / "law")
    (tmp_path / "law" / "main.c").write_text(
        """
#include "law.h"
#include <math.h>
int main(void) {
  law_state self;
  law_real q[2] = {0.1, 0.2}, v[2] = {0.1, -0.2}, seen[2] = {1.0, 2.0}, torque[2];
  law_init(&self);
  if (law_step(&self, q, v, seen, 0.001, torque) != LAW_OK) return 1;
  const law_real bad[3] = {NAN, INFINITY, -INFINITY};
  for (int k = 0; k < 3; k++) {
    seen[1] = bad[k], torque[0] = torque[1] = 7.0;
    if (law_step(&self, q, v, seen, 0.001, torque) != LAW_BAD_INPUT || torque[0] != 0.0 || torque[1] != 0.0) return 2;
    seen[1] = 2.0, self.state[1] = bad[k], torque[0] = torque[1] = 7.0;
    if (law_step(&self, q, v, seen, 0.001, torque) != LAW_BAD_INPUT || torque[0] != 0.0 || torque[1] != 0.0) return 3;
    law_init(&self);
  }
  v[0] = v[1] = 1.7e308;
  if (law_step(&self, q, v, seen, 0.001, torque) != LAW_STOPPED) return 4;
  return isfinite(torque[0]) && isfinite(torque[1]) ? 0 : 5;
}
"""
    )
    assert run(build(tmp_path / "law", [compiler.path], "-std=c99", *SANITIZED)).returncode == 0


def test_jumps_and_a_beginning_that_depends_on_the_posture_are_refused(shoulder, tmp_path):
    law = Integral(shoulder)
    law.first = lambda x: 2.0 * x.position
    with pytest.raises(CompilationError, match="its initial state depends on the arm's"):
        export_law(law, tmp_path / "law")
    jumping = Integral(shoulder)
    jumping.jumps = True
    with pytest.raises(CompilationError, match="its state jumps"):
        export_law(jumping, tmp_path / "law")
    assert not (tmp_path / "law").exists()
