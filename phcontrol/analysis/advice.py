"""What it means that a line of a certificate failed: where in a law to look."""

from __future__ import annotations

ADVICE: dict[str, str] = {
    "matching residual": (
        "the arm does not move as the target says. In rows of the momentum: the model does not fit the plant (mass, "
        "friction, armature), f_e enters otherwise than the port says, or shape() states another torque. In other "
        "rows: their rate along the motion is not what J_d makes of ∇H_d; the coupling, a moving goal or a "
        "coordinate's derivative is wrong"
    ),
    "gradient residual": (
        "target's gradient is not the gradient of storage() by target's coordinates: a term is missing in one of the "
        "two (a state of the law, the kinetic energy), or has another factor"
    ),
    "skewness of J_d": "the interconnection is not skew: a block that is not minus the transpose of its mirror image",
    "indefiniteness of R_d": "the dissipation is not symmetric positive semidefinite: a damping is negative somewhere",
    "growth of H_d beyond what is supplied": (
        "the storage function gains energy that neither f_e nor what drives the law brings: mostly what another failed "
        "line says; alone, f_e enters otherwise than the port says"
    ),
    "growth of H_d with time alone": (
        "H_d rises while the clock runs and nothing moves: a stiffness that grows brings energy in; pay for it out "
        "of a tank"
    ),
    "jump of H_d between states": "H_d jumps: gains or a goal that switch, a term behind an if",
    "kink of H_d between states": (
        "H_d has no gradient at a point, and the torque jumps there: an absolute value, an if, or an error that is "
        "folded at half a turn of a joint that is not continuous (x.position_error folds where it should)"
    ),
    "balance of H_d along runs": "H_d jumps within a run: gains or a goal that switch",
    "jump of H_d at switches, untold": (
        "where a phase of the law begins H_d is another: a switch may bring energy in. Say in caveat that it does"
    ),
    "target's coordinates are others": "coordinates() and target().coordinates differ",
    "least dissipation in motion [1/s]": "a motion is not damped at all: R_d has no damping in its direction",
    "depth of H_d below its rest": "H_d is lower elsewhere than where the law rests: it is no minimum",
    "other rests as deep as the goal": (
        "H_d is as low at another posture in the joint range: the arm may come to rest there. An error folded at half "
        "a turn of a joint that is not continuous, or a potential with more than one minimum"
    ),
    "energy of the law's initial state": "initial_state() stores energy: there H_d is not at its minimum",
    "drive that is not declared": "the target has a drive that brings energy in: name it in driven_by",
    "drive in rows of a momentum": "a drive enters as a torque; it may enter other rows only",
    "drive that is declared": "driven_by names a drive, but the target has none",
    "drive that depends on the state": "a drive's signal must come from outside: time and measurements alone",
    "velocities and states not promised": (
        "the target's coordinates leave a velocity or a state of the law out: nothing is said about what it does"
    ),
    "command that is not repeated": (
        "the same question has two answers: the law remembers something, writes to what it is given, or hands out an "
        "array that changes later"
    ),
    "command that remembers the motion": "the law remembers earlier calls: only its arguments may count in evaluate()",
    "command that other methods change": (
        "evaluate() answers otherwise after storage(), passive_port() or another method was asked, or after all that a "
        "certificate asks: a law has no memory but its state"
    ),
    "change by what is not needed": "the law reads a measurement that needs does not name",
    "change with time that is not declared": "the law depends on t, but its time_span is 0",
    "change of the promise with f_e": "J_d, R_d, H_d or a coordinate depends on f_e, which may enter by the port only",
    "output of f_e that is no velocity": "portᵀ∇H_d does not move with q̇: such a loop is not passive in contact",
    "passive port that is another": (
        "the passive port is not what the target says; a derived one needs a momentum p̂ = p̄ + θ and other coordinates "
        "that do not depend on q̇: state it otherwise"
    ),
    "damping that is not dissipated": (
        "joint_damping() or injected_damping is more than R_d takes: both say what the law injects, and a tank or a "
        "bound of the gain relies on them"
    ),
    "rise of H_d to the calmest state": "calmest_state() is not where H_d is smallest",
    "rise of H_d by a jump": "jump() changes the law's state: without saying so in jumps, or to one of more energy",
    "rise of H_d under limits": (
        "rate_under_limits() must return the rate as it is where the torque is not changed, and never put energy into "
        "the law's state"
    ),
    "desired posture that is another": "desired_posture() is not target_posture() where the law has just begun",
    "no rest near the goal": "∇H_d vanishes nowhere near rest_posture(): goal and potential do not belong together",
    "motion where it should rest": "the arm moves where ∇H_d = 0: the torque is not what the target says",
    "distance from its goal at rest": "∇H_d vanishes elsewhere than at the goal: the potential is not smallest there",
    "smallest curvature of H_d at rest": (
        "H_d has no strict minimum where the law rests: a stiffness that is not positive, a state without energy; or "
        "say in lacks_minimum what the law has instead"
    ),
    "rest in contact only": "the law rests only in contact: say so in lacks_minimum",
    "largest real part at rest [1/s]": (
        "the linearised closed loop is not asymptotically stable: no damping in some direction, or an outer loop that "
        "is too fast for what it touches"
    ),
    "largest real part when it is touched [1/s]": (
        "what f_e drives goes against what it touches, and the linearised loop with a spring there is unstable"
    ),
    "largest real part when it is pushed [1/s]": (
        "a large f_e drives the law otherwise than a small one, and against what it touches: its answer to f_e must "
        "not turn round, nor grow with the size of f_e"
    ),
    "least dissipation with nothing to see [1/s]": (
        "where nothing is seen the law must brake, and R_d has no damping there"
    ),
}
"""By the line's name."""
