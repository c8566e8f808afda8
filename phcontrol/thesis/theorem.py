"""The thesis's theorems on closed loops, each with the law that realises it here."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Theorem:
    """A theorem or equation that promises a closed loop."""

    name: str
    closed_loop: str
    """Where its closed loop is printed."""
    statement: str
    laws: tuple[str, ...]
    """The laws that realise it, as ``CONTROLLERS`` names them."""
    robot: str
    """The thesis's arm for it."""
    errata: str

    @property
    def claim(self) -> str:
        """What its certificates are about: the closed loop, from which stability follows."""
        return f"under the law of {self.name[:1].lower()}{self.name[1:]} the closed loop is {self.closed_loop}"


THEOREMS = (
    Theorem("Theorem 3.2.1", "(3.12)", "position control with force feedback is port-Hamiltonian and stable at q_d",
            ("force_feedback", "force_feedback_measured"), "pera_shoulder", "E8 to E11"),
    Theorem("Theorem 3.2.5", "(3.45)", "integral position control has no steady-state error under a constant force",
            ("integral_action",), "pera_shoulder", "E11, E13"),
    Theorem("Section 3.3", "(3.56)", "with measured total forces all forces are cancelled",
            ("total_force_rejection",), "pera_shoulder", "E7"),
    Theorem("Theorem 4.1.1", "(4.17)", "force control brings the force of the environment to f_d",
            ("force_control",), "pera_gripper", "E14, E23"),
    Theorem("Theorem 4.2.3", "(4.56)", "impedance grasping brings the arm to the virtual position q_f",
            ("impedance_grasping",), "pera_gripper", "E15, E27"),
    Theorem("Theorem 5.2.2", "(5.17)", "visual servoing by reduction: p̂ dies out",
            ("reduction_servo",), "pera_shoulder_elbow", "E16 to E18"),
    Theorem("Theorem 5.2.3", "(5.46)", "visual servoing with a port-Hamiltonian closed loop on p̃ and the features",
            ("hamiltonian_servo",), "pera_shoulder_elbow", "E16 to E19"),
    Theorem("Theorem 6.1.1", "(6.2), (6.7)", "trajectory tracking by a canonical transformation",
            ("tracking", "tracking_measured"), "pera_shoulder", "E22, E26"),
)  # fmt: skip
