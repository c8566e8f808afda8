"""What may happen while a law acts, for schedules that switch on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array, choice, number, positive
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, MissingMeasurementError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import Measured
from phcontrol.vision.scene import Eyes


class Moment(NamedTuple):
    """What an event is judged by.

    Example:
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, Measured, MechanicalSystem, Moment, Touched, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> felt = Measured(external_force=np.array([0.0, 0.8]))
        >>> law = EnergyShaping.tuned(system)
        >>> moment = Moment(system.at([0.0, 0.0]), felt, law, time=0.1, elapsed=0.1, eyes=None)
        >>> Touched(0.5).holds(moment)
        True
    """

    x: MechanicalState
    """State of the arm."""
    measured: Measured
    """What sensors show."""
    law: Controller
    """The law that acts."""
    time: float
    """How long it has acted [s]."""
    elapsed: float
    """How long the phase has lasted [s]."""
    eyes: Eyes | None
    """What the schedule sees by."""


class Event(ABC):
    """Something that happens once it has held for ``lasting`` without a break.

    Args:
        lasting: [s].

    Example:
        >>> from phcontrol import NOTHING, EnergyShaping, Event, MechanicalSystem, Moment, load_robot
        >>> class Fast(Event):
        ...     def holds(self, moment):
        ...         return bool(abs(moment.x.velocity).max() > 1.0)  # [rad/s]
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping.tuned(system)
        >>> moment = Moment(system.at([0.0, 0.0], [2.0, 0.0]), NOTHING, law, 0.0, 0.0, None)
        >>> Fast(lasting=0.1).holds(moment)
        True
    """

    needs: tuple[str, ...] = ()
    """Fields of Measured that it is judged by."""

    def __init__(self, lasting: float) -> None:
        self.lasting = number("lasting", lasting, minimum=0.0)

    @abstractmethod
    def holds(self, moment: Moment) -> bool:
        """Return whether it is so at one instant."""

    def check(self, system_joints: tuple[str, ...], eyes: Eyes | None) -> None:
        """Raise InvalidArgumentError or UnknownNameError where a schedule has not what it takes to judge it."""
        for name in self.needs:
            choice("measurement", name, Measured._fields)

    def __str__(self) -> str:
        return type(self).__name__.lower()


class _Sight(Event):
    needs = ("features",)

    def check(self, system_joints: tuple[str, ...], eyes: Eyes | None) -> None:
        """Demand a law with a camera."""
        if eyes is None:
            raise InvalidArgumentError("phases", f"the event '{self}' needs a law that sees: none of them has a camera")

    def _sees(self, moment: Moment) -> bool:
        features = _measured(moment, "features", str(self))
        assert moment.eyes is not None
        return moment.eyes.camera.sees(features)


class Seen(_Sight):
    """The object is in the image of the camera that a law of the schedule steers by.

    Example:
        >>> import numpy as np
        >>> from phcontrol import HamiltonianServo, Measured, MechanicalSystem, Moment, PinholeCamera, Seen
        >>> from phcontrol import load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> servo = HamiltonianServo.tuned(system, [0.0, 0.0, 0.002], camera=PinholeCamera())
        >>> there = Measured(features=np.array([0.001, 0.0, 0.002]))
        >>> x = system.at(system.robot.home)
        >>> Seen().holds(Moment(x, there, servo, time=1.0, elapsed=1.0, eyes=servo.eyes))
        True
    """

    def __init__(self, lasting: float = 0.1) -> None:
        super().__init__(lasting)

    def holds(self, moment: Moment) -> bool:
        """Return whether it is seen."""
        return self._sees(moment)


class Lost(_Sight):
    """The object is not in the image.

    Example:
        >>> import numpy as np
        >>> from phcontrol import HamiltonianServo, Lost, Measured, MechanicalSystem, Moment, PinholeCamera
        >>> from phcontrol import Seen, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> servo = HamiltonianServo.tuned(system, [0.0, 0.0, 0.002], camera=PinholeCamera())
        >>> unseen = Measured(features=np.full(3, np.nan))
        >>> x = system.at(system.robot.home)
        >>> moment = Moment(x, unseen, servo, time=1.0, elapsed=1.0, eyes=servo.eyes)
        >>> Lost().holds(moment), Seen().holds(moment)
        (True, False)
    """

    def __init__(self, lasting: float = 0.5) -> None:
        super().__init__(lasting)

    def holds(self, moment: Moment) -> bool:
        """Return whether it is not seen."""
        return not self._sees(moment)


class Touched(Event):
    """The environment pushes: |f_e| of a joint, or of any, is at least ``force``.

    Args:
        force: [N·m].
        joint: its name; None for any joint.
        lasting: [s]; long enough for noise not to be taken for it.

    Example:
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, Measured, MechanicalSystem, Moment, Touched, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> felt = Measured(external_force=np.array([0.0, -0.8]))  # [N·m]
        >>> law = EnergyShaping.tuned(system)
        >>> moment = Moment(system.at([0.0, 0.0]), felt, law, time=0.1, elapsed=0.1, eyes=None)
        >>> Touched(0.5).holds(moment), Touched(1.0).holds(moment)
        (True, False)
    """

    needs = ("external_force",)

    def __init__(self, force: float, joint: str | None = None, lasting: float = 0.02) -> None:
        super().__init__(lasting)
        self.force, self.joint = positive("force", force), joint

    def check(self, system_joints: tuple[str, ...], eyes: Eyes | None) -> None:
        """Demand that the joint exists."""
        if self.joint is not None and self.joint not in system_joints:
            raise InvalidArgumentError("joint", f"'{self.joint}' is none of {', '.join(system_joints)}")

    def holds(self, moment: Moment) -> bool:
        """Return whether it pushes so much."""
        force = np.abs(_measured(moment, "external_force", str(self)))
        at = force.max() if self.joint is None else force[moment.x.system.robot.joint_index(self.joint)]
        return bool(at >= self.force)


class Settled(Event):
    """The arm is nearly at rest, its law leads it no more, and where that is asked, it is near what the law desires.

    Args:
        speed: largest |q̇_i| [rad/s].
        features: largest error |τ_i − τ_d,i| of a law that sees [m]; None for any. What is not seen is not settled.
        position: largest error of a joint from the posture that the law desires [rad]; None for any.
        lasting: [s].

    Example:
        >>> from phcontrol import NOTHING, EnergyShaping, MechanicalSystem, Moment, Settled, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping.tuned(system, [0.2, 0.0])
        >>> moment = Moment(system.at([0.0, 0.0]), NOTHING, law, time=1.0, elapsed=1.0, eyes=None)
        >>> Settled(0.01).holds(moment), Settled(0.01, position=0.05).holds(moment)
        (True, False)
    """

    def __init__(
        self,
        speed: float = 0.01,
        *,
        features: float | None = None,
        position: float | None = None,
        lasting: float = 0.3,
    ) -> None:
        super().__init__(lasting)
        self.speed = positive("speed", speed)
        self.features = None if features is None else positive("features", features)
        self.position = None if position is None else positive("position", position)
        self.needs = () if features is None else ("features",)

    def holds(self, moment: Moment) -> bool:
        """Return whether it is at rest there."""
        x, law = moment.x, moment.law
        if np.abs(x.velocity).max() > self.speed or moment.time < law.time_span - 1e-9:
            return False
        if self.features is not None:
            eyes = law.eyes
            seen = _measured(moment, "features", str(self))
            # NaN, of what is not seen, is not small
            if eyes is None or not np.abs(seen - eyes.goal).max() <= self.features:
                return False
        if self.position is not None:
            posture = law.target_posture(moment.time)
            if posture is None or np.abs(x.position_error(posture)).max() > self.position:
                return False
        return True


class After(Event):
    """The phase has lasted for so long.

    Args:
        seconds: [s].

    Example:
        >>> from phcontrol import NOTHING, After, EnergyShaping, MechanicalSystem, Moment, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping.tuned(system)
        >>> moment = Moment(system.at(system.robot.home), NOTHING, law, time=0.4, elapsed=0.4, eyes=None)
        >>> After(0.5).holds(moment), After(0.3).holds(moment)
        (False, True)
    """

    def __init__(self, seconds: float) -> None:
        super().__init__(0.0)
        self.seconds = positive("seconds", seconds)

    def holds(self, moment: Moment) -> bool:
        """Return whether the time is over."""
        return moment.elapsed >= self.seconds - 1e-9


class When(Event):
    """Whatever a function says.

    Args:
        condition: (moment) → whether it is so; a pure function.
        name: what it is called in reports.
        needs: fields of Measured that the function reads.
        lasting: [s].

    Example:
        >>> from phcontrol import NOTHING, EnergyShaping, MechanicalSystem, Moment, When, load_robot
        >>> still = When(lambda moment: abs(moment.x.velocity).max() < 0.01, "still", lasting=0.1)
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping.tuned(system)
        >>> still.holds(Moment(system.at([0.0, 0.0]), NOTHING, law, 1.0, 1.0, None)), str(still)
        (True, 'still')
    """

    def __init__(
        self,
        condition: Callable[[Moment], bool],
        name: str = "when",
        *,
        needs: tuple[str, ...] = (),
        lasting: float = 0.0,
    ) -> None:
        super().__init__(lasting)
        if not callable(condition):
            raise InvalidArgumentError("condition", f"must be a function of a Moment, but is {condition!r}")
        self.condition, self.name, self.needs = condition, name, needs

    def holds(self, moment: Moment) -> bool:
        """Return what the function says."""
        return bool(self.condition(moment))

    def __str__(self) -> str:
        return self.name


def _measured(moment: Moment, name: str, event: str) -> Array:
    value: Array | None = getattr(moment.measured, name)
    if value is None:
        raise MissingMeasurementError(f"the event '{event}'", name)
    return value
