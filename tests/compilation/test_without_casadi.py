"""CasADi is an option: without it everything else works, and what needs it says what to install."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import sys, warnings

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "casadi":
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)

sys.modules.pop("casadi", None)
sys.meta_path.insert(0, Blocked())
import importlib.util
find_spec = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name == "casadi" else find_spec(name, *rest)

from typer.testing import CliRunner
import phcontrol
from phcontrol.cli import app

arm = phcontrol.MechanicalSystem(phcontrol.load_robot("pera_shoulder"))
law = phcontrol.make_controller("energy_shaping", arm)
try:
    phcontrol.compile_law(law)
except phcontrol.CompilationError as error:
    print(error)
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    phcontrol.simulate(arm, law, duration=0.01, compiled=True)
print(caught[-1].message)
exported = CliRunner().invoke(app, ["export", "--controller", "energy_shaping", "--out", "nowhere"])
print(exported.exit_code, exported.stderr.strip())
print([line for line in CliRunner().invoke(app, ["doctor"]).stdout.splitlines() if "casadi" in line])
"""


def test_without_casadi():
    result = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    law, run, command, doctor = result.stdout.splitlines()
    need = "casadi is needed to write a law down as C: pip install 'phcontrol[compile]'"
    assert law == need
    assert run == f"the run is simulated interpreted: {need}"
    assert command == f"2 error: {need}"
    assert "missing: casadi, for compile_law and phcontrol export: pip install 'phcontrol[compile]'" in doctor
