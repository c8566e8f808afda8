"""Writes the notebooks of the documentation from their cells here: ``python docs/make_notebooks.py``.

They are kept without outputs, and the tests execute them.
"""

# ruff: noqa: E501

from __future__ import annotations

from pathlib import Path

from phcontrol._files import write_text
from phcontrol.cli.project_files import notebook

FOLDER = Path(__file__).parent / "notebooks"

FIRST_ARM = [
    ("markdown", "# A first arm\n\nLoad a UR5, choose a law, certify it, run it, look at it. About five minutes."),
    (
        "code",
        "from phcontrol import MechanicalSystem, load_robot\n\n"
        'robot = load_robot("ur5")  # or "panda", or the path of your URDF\n'
        "robot.joint_names, robot.effort_limit  # [N·m]",
    ),
    ("markdown", "The plant is the arm with its friction. At one state it has every quantity of the dynamics."),
    (
        "code",
        "system = MechanicalSystem(robot)\n"
        "x = system.at(robot.home)\n"
        "x.mass_matrix.diagonal(), x.gravity  # [kg m²], [N·m]",
    ),
    (
        "markdown",
        "A law with gains that suit the arm, led to its goal within the velocity limits: a goal that jumps asks for large"
        "\ntorques.",
    ),
    (
        "code",
        "from phcontrol import MinimumJerk, make_controller\n\n"
        "goal = robot.near_home()  # [rad]\n"
        "way = MinimumJerk.within_limits(robot, robot.home, goal)\n"
        'law = make_controller("force_feedback", system, reference=way)\n'
        "way.duration, law.stiffness.diagonal()  # [s], [N·m/rad]",
    ),
    ("markdown", "The certificate holds the closed loop against the port-Hamiltonian system that the law promises."),
    ("code", "from phcontrol import certify\n\ncertificate = certify(law, system, samples=64)\nprint(certificate)"),
    (
        "code",
        "from phcontrol import simulate\n\n"
        "log = simulate(system, law, duration=way.duration + 2.0, dt=2e-3, progress=False)\n"
        "abs(log.position[-1] - goal).max()  # [rad]",
    ),
    ("code", "log.plot();"),
    (
        "markdown",
        'Logs can be kept (`log.save("run.npz")`), laid over each other (`compare`), and played in a browser:\n'
        '`record(log, "run.html")` writes a page that needs no network.',
    ),
    (
        "code",
        "from phcontrol import compare\n\n"
        'stiffer = make_controller("force_feedback", system, reference=way, bandwidth=12.0)  # [rad/s]\n'
        "again = simulate(system, stiffer, duration=way.duration + 2.0, dt=2e-3, progress=False)\n"
        'compare({"as tuned": log, "12 rad/s": again});',
    ),
]

OWN_LAW = [
    (
        "markdown",
        "# A law of your own\n\n"
        "A law states its energy H_d and the port-Hamiltonian system that the closed loop will be. Its torque follows, and\n"
        "so does its certificate. Here: a spring that never pulls with more than a given torque.",
    ),
    (
        "code",
        "import numpy as np\n\n"
        "from phcontrol import Controller, Gain, Positive, PositiveVector, Target, Vector\n\n\n"
        "class BoundedSpring(Controller):\n"
        '    """H_d = kinetic energy + Σ k w² log cosh(q̃/w): a spring k near the goal, a torque k w far from it."""\n\n'
        '    name = "bounded_spring"\n'
        '    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)\n'
        '    stiffness: PositiveVector = PositiveVector("k", "N·m/rad", tuned=lambda tuning: '
        "tuning.stiffness.diagonal())\n"
        '    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)\n'
        '    width: Positive = Positive("w", "rad", default=0.2)\n\n'
        "    def storage(self, t, x, state, measured=None):\n"
        "        far = np.abs(x.position_error(self.goal)) / self.width\n"
        "        log_cosh = far + np.log1p(np.exp(-2.0 * far)) - np.log(2.0)\n"
        "        return x.kinetic_energy + self.width**2 * self.stiffness @ log_cosh\n\n"
        "    def target(self, t, x, state, measured=None):\n"
        "        error = x.position_error(self.goal)\n"
        "        pull = self.stiffness * self.width * np.tanh(error / self.width)\n"
        "        return Target.mechanical(x, self.interconnection, error=error, gradient=pull, damping=self.damping)",
    ),
    (
        "code",
        "from phcontrol import MechanicalSystem, certify, load_robot\n\n"
        'system = MechanicalSystem(load_robot("pera_shoulder_elbow"))\n'
        "law = BoundedSpring.tuned(system, system.robot.near_home())\n"
        "print(certify(law, system, samples=64).verdict)",
    ),
    (
        "markdown",
        "What if the gradient does not belong to the energy? The certificate says which line fails, and what it means.",
    ),
    (
        "code",
        "class Wrong(BoundedSpring):\n"
        '    name = "wrong"\n\n'
        "    def storage(self, t, x, state, measured=None):\n"
        "        return x.kinetic_energy + 0.5 * np.sum(self.stiffness * x.position_error(self.goal) ** 2)  # a plain spring's"
        "\n\n\nprint(certify(Wrong.tuned(system, system.robot.near_home()), system, samples=64))",
    ),
    ("markdown", "The right one runs on any arm, interpreted or compiled, in simulation and in a control loop."),
    (
        "code",
        "from phcontrol import simulate\n\n"
        "log = simulate(system, law, duration=6.0, dt=2e-3, progress=False)\n"
        "abs(log.position[-1] - law.goal).max(), np.diff(log.storage).max()  # [rad], [J]: it never grew",
    ),
    ("code", "log.plot.energy();"),
]

CARTESIAN = [
    (
        "markdown",
        "# Cartesian impedance\n\n"
        "The hand of a Panda on a spring and a damper. Pushed, it gives way by force over stiffness; let go, it comes back.",
    ),
    (
        "code",
        "import numpy as np\n\n"
        "from phcontrol import CartesianImpedance, MechanicalSystem, certify, load_robot\n\n"
        'system = MechanicalSystem(load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"]))\n'
        "law = CartesianImpedance.tuned(\n"
        "    system,\n"
        "    translational_stiffness=[600.0, 600.0, 200.0],  # [N/m], in the axes of the world\n"
        "    rotational_stiffness=30.0,  # [N·m/rad]\n"
        "    damping_ratio=0.7,\n"
        ")\n"
        "print(certify(law, system, samples=32))",
    ),
    ("markdown", "A push of 4 N downwards from 1 s to 3 s: 4 N over 200 N/m are 20 mm."),
    (
        "code",
        "from phcontrol import Wrench, simulate\n\n"
        "frame = system.hand_frame\n"
        "push = Wrench(frame, lambda t: np.array([0.0, 0.0, -4.0 if 1.0 < t < 3.0 else 0.0, 0.0, 0.0, 0.0]))\n"
        "start = system.robot.near_home()  # where the hand is at its goal\n"
        "log = simulate(system, law, duration=5.0, dt=2e-3, q0=start, disturbance=push, progress=False)\n"
        "hand = 1e3 * (log.frame(frame).position - log.frame(frame).position[0])  # [mm]\n"
        "hand[log.time.searchsorted(2.9)].round(2), hand[-1].round(2)",
    ),
    (
        "code",
        "import matplotlib.pyplot as plt\n\n"
        'plt.plot(log.time, hand, label=["x", "y", "z"])\n'
        'plt.xlabel("t [s]")\n'
        'plt.ylabel("hand [mm]")\n'
        "plt.legend();",
    ),
    (
        "markdown",
        "Seven joints, six directions of the hand: the elbow is free. A spring on the posture is not passive when it may\n"
        "not touch the hand; an energy tank pays for it.",
    ),
    (
        "code",
        'tanked = law.tuned(system, translational_stiffness=600.0, rotational_stiffness=30.0, posture="tank")\n'
        "log = simulate(system, tanked, duration=2.0, dt=2e-3, q0=start, progress=False)\n"
        "log.tank_level.min(), log.tank_level.max()  # [J]",
    ),
]

CERTIFICATE = [
    (
        "markdown",
        "# How a law is certified\n\n"
        "A law promises that the closed loop, in coordinates x of its own, is ẋ = (J − R)∇H_d + port·f_e, with J skew and R\n"
        "positive semidefinite. A certificate holds this against the arm's true motion. Here one state by hand.",
    ),
    (
        "code",
        "import numpy as np\n\n"
        "from phcontrol import ForceFeedback, MechanicalSystem, load_robot\n\n"
        'system = MechanicalSystem(load_robot("pera_shoulder_elbow"))\n'
        "law = ForceFeedback.tuned(system, system.robot.near_home())\n"
        "q, v, z = np.array([0.2, 0.1, -0.4]), np.array([0.5, -0.3, 0.8]), np.array([0.1, 0.2, -0.1])\n"
        "target = law.target(0.0, system.at(q, v), z)\n"
        "promised = (target.interconnection - target.dissipation) @ target.gradient\n"
        "list(target.parts), promised.round(3)",
    ),
    (
        "markdown",
        "The truth: the plant's acceleration under the law's torque, and the coordinates' rate along that motion.",
    ),
    (
        "code",
        "def coordinates_after(h):\n"
        '    """Return the law\'s coordinates h seconds later, to second order along the true motion."""\n'
        "    x = system.at(q, v)\n"
        "    command = law.evaluate(0.0, x, z)\n"
        "    acceleration = x.acceleration(command.torque)\n"
        "    later = system.at(q + h * v + 0.5 * h**2 * acceleration, v + h * acceleration)\n"
        "    return law.coordinates(h, later, z + h * command.state_rate)\n\n\n"
        "h = 1e-5  # [s]\n"
        "true = (coordinates_after(h) - coordinates_after(-h)) / (2.0 * h)\n"
        "abs(true - promised).max()",
    ),
    ("markdown", "The structure: J skew, R without a negative eigenvalue, so that H_d can only fall."),
    (
        "code",
        "J, R = target.interconnection, target.dissipation\n"
        "abs(J + J.T).max(), np.linalg.eigvalsh(R).min(), target.gradient @ promised  # [W]: the rate of H_d",
    ),
    (
        "markdown",
        "`certify` does this at states spread over where laws go wrong, looks at the rest point and the linear loop there,\n"
        "and says what it looked at.",
    ),
    ("code", "from phcontrol import certify\n\nprint(certify(law, system, samples=128))"),
    (
        "markdown",
        "It must be able to fail. The same law on an arm that carries 0.3 kg, of which the law knows nothing:",
    ),
    (
        "code",
        "from phcontrol import Payload\n\n"
        'heavier = MechanicalSystem(load_robot("pera_shoulder_elbow", payload=Payload(0.3)))  # [kg]\n'
        "certify(law, heavier, samples=64).verdict",
    ),
    (
        "markdown",
        "A certificate samples; it is no proof. What it cannot see is on the page *Choosing a controller*.",
    ),
]

NOTEBOOKS = {
    "first-arm": FIRST_ARM,
    "own-law": OWN_LAW,
    "cartesian-impedance": CARTESIAN,
    "certificate": CERTIFICATE,
}

if __name__ == "__main__":
    for name, cells in NOTEBOOKS.items():
        print(write_text(FOLDER / f"{name}.ipynb", notebook(cells)))
