"""What happened in a run, and the energy that flowed."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phcontrol._validation import Array, choice
from phcontrol.exceptions import DataFileError, InvalidArgumentError, PHControlError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.derived import DERIVED, OPTIONAL, PARTS, Sample, derive, names_of, true_measurement
from phcontrol.simulation.frame_motion import FrameMotion
from phcontrol.simulation.log_file import FEATURES, FILTER, LARGEST, MEASURED, read_log, write_log
from phcontrol.simulation.plant_record import plant_from_record, plant_record
from phcontrol.simulation.power_balance import PowerBalance
from phcontrol.simulation.sampled_control import SampledControl
from phcontrol.simulation.signals import Exported, Signal, Signals
from phcontrol.simulation.vector_field import ClosedLoop, Evaluation

if TYPE_CHECKING:
    import pandas


JOINTS_SHOWN = ("position", "velocity")
"""What a joint sensor shows, as quantities in ``Log.measured``."""


class Log(Exported):
    """A run: times, states, torques, forces, and the energies derived from them.

    Rows are samples k at ``time[k]``. What follows from the trajectory (energies, powers: ``DERIVED`` says how) is
    computed on first use and kept; a saved log has it all.

    Example:
        >>> import tempfile
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, Log, MechanicalSystem, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> log = simulate(system, EnergyShaping.tuned(system, [0.2, 0.1]), duration=0.5, dt=5e-3, q0=[0.0, 0.0])
        >>> log.position.shape, bool(np.diff(log.storage).max() < 1e-9)
        ((101, 2), True)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     again = Log.load(log.save(folder + "/run.npz"))
        >>> np.array_equal(again.position, log.position)
        True
    """

    def __init__(self, data: dict[str, Array], metadata: dict[str, Any], loop: ClosedLoop | None = None) -> None:
        self.metadata = metadata
        """Robot, controller, integrator, step, versions."""
        self.path: Path | None = None
        """The file that the log was read from; None for a run of this process."""
        self._data, self._loop, self._length = data, loop, len(data["time"])
        self._states: Array = np.zeros((0, 0))
        self._columns = {name: data[name] for name in DERIVED if name in data}
        whole = all(name in data for name in DERIVED if name not in OPTIONAL)
        self._known: frozenset[str] = PARTS if whole else frozenset()
        self._arm: dict[str, Array] | None = None

    @classmethod
    def empty(
        cls,
        loop: ClosedLoop,
        samples: int,
        state_size: int,
        body_state_size: int,
        measured: Sequence[str],
        metadata: dict[str, Any],
        *,
        filtered: bool = False,
    ) -> Log:
        """Return a log with room for a run, to be filled by ``record``.

        Raises InvalidArgumentError where there is no room for so many samples.
        """
        sizes = {"torque": loop.n, "external_force": loop.n}
        sizes |= {f"{MEASURED}{quantity}": FEATURES if quantity == "features" else loop.n for quantity in measured}
        if loop.scene is not None:
            sizes["features"] = FEATURES
        if filtered:
            sizes[f"{FILTER}desired_torque"] = loop.n
            sizes |= {f"{FILTER}{name}": 0 for name in ("status", "motion_excess", "storage_excess")}
        n, width = loop.n, 2 * loop.n + state_size + body_state_size
        try:
            states: Array = np.zeros((samples, width))
            data = {
                name: np.zeros((samples, size) if size else samples) for name, size in ({"time": 0} | sizes).items()
            }
        except (MemoryError, ValueError, OverflowError) as error:
            raise InvalidArgumentError("duration", "and dt ask for more samples than there is room for") from error
        data |= {
            "position": states[:, :n],
            "velocity": states[:, n : 2 * n],
            "controller_state": states[:, 2 * n : 2 * n + state_size],
            "body_state": states[:, 2 * n + state_size :],
        }
        log = cls(data, metadata, loop)
        log._length, log._states = 0, states
        return log

    def record(self, k: int, t: float, y: Array, found: Evaluation) -> None:
        """Write sample k, and what the loop was found to be there."""
        data = self._data
        data["time"][k] = t
        self._states[k] = y
        data["torque"][k] = found.torque
        data["external_force"][k] = found.external_force
        if found.features is not None:
            data["features"][k] = found.features
        self._length = k + 1

    def fill(
        self, first: int, dt: float, states: Array, torques: Array, forces: Array, shown: Array, joints: Array
    ) -> None:
        """Write what a run in C recorded: rows from sample first on."""
        rows, data = slice(first, first + len(states)), self._data
        data["time"][rows] = dt * np.arange(first, first + len(states))
        self._states[rows] = states
        data["torque"][rows], data["external_force"][rows] = torques, forces
        halves = np.split(joints, 2, axis=1)
        of_joints = {f"{MEASURED}{name}": half for name, half in zip(JOINTS_SHOWN, halves, strict=True)}
        for name in data:
            if name.startswith(MEASURED):
                data[name][rows] = of_joints.get(name, shown)

    def end(self, samples: int) -> None:
        """Say how many samples a run in C has recorded."""
        self._length = samples

    def record_measured(self, k: int, measured: Measured) -> None:
        """Write what the sensors showed at sample k."""
        for quantity, value in measured._asdict().items():
            if value is not None:
                self._data[f"{MEASURED}{quantity}"][k] = value

    def record_joints(self, k: int, seen: MechanicalState) -> None:
        """Write what the joint sensor showed at sample k."""
        for name in JOINTS_SHOWN:
            self._data[f"{MEASURED}{name}"][k] = getattr(seen, name)

    def record_filter(self, k: int, sampled: SampledControl) -> None:
        """Write what the torque filter did in the period of sample k."""
        data = self._data
        assert sampled.filtered is not None
        data[f"{FILTER}desired_torque"][k] = sampled.desired
        data[f"{FILTER}status"][k] = sampled.filtered.status
        data[f"{FILTER}motion_excess"][k] = sampled.filtered.motion_excess
        data[f"{FILTER}storage_excess"][k] = sampled.filtered.storage_excess

    def truncated(self) -> Log:
        """Return the part that was recorded."""
        return Log({name: array[: self._length] for name, array in self._data.items()}, self.metadata, self._loop)

    def __len__(self) -> int:
        return self._length

    def __repr__(self) -> str:
        end = f"{self.time[-1]:g} s" if len(self) else "nothing"
        return f"<Log of {self.metadata['controller']} on {self.metadata['robot']}: {len(self)} samples, {end}>"

    # --- recorded -----------------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """Times k·dt, shape (N,) [s]."""
        return self._data["time"]

    @property
    def position(self) -> Array:
        """q, shape (N, n) [rad]."""
        return self._data["position"]

    @property
    def velocity(self) -> Array:
        """q̇, shape (N, n) [rad/s]."""
        return self._data["velocity"]

    @property
    def torque(self) -> Array:
        """The applied torque u, shape (N, n) [N·m]."""
        return self._data["torque"]

    @property
    def external_force(self) -> Array:
        """f_e, shape (N, n) [N·m]."""
        return self._data["external_force"]

    @property
    def controller_state(self) -> Array:
        """The controller's own state, shape (N, size)."""
        return self._data["controller_state"]

    @property
    def body_state(self) -> Array:
        """The touched bodies' own states, then the scene's, shape (N, size)."""
        return self._data["body_state"]

    @property
    def features(self) -> Array:
        """True image features (μ, ν, l), shape (N, 3) [m]. Raises PHControlError for a run without a scene."""
        if "features" not in self._data:
            raise PHControlError("this log has no image features: the run had no scene")
        return self._data["features"]

    @property
    def measured(self) -> dict[str, Array]:
        """What sensors showed, shape (N, n), by quantity; empty when the controller was shown the truth.

        "external_force" and other fields of ``Measured``; "position" and "velocity" of a joint sensor.
        """
        return {name[len(MEASURED) :]: array for name, array in self._data.items() if name.startswith(MEASURED)}

    @property
    def filter_activity(self) -> dict[str, Array]:
        """What the torque filter did, by name; empty without one.

        "desired_torque" (N, n): what the law desired [N·m]; "status" (N,): a ``FilterStatus`` each;
        "motion_excess" (N,): predicted velocity beyond its bounds [rad/s]; "storage_excess" (N,): power given to H_d
        beyond what the law was dissipating [W].
        """
        return {name[len(FILTER) :]: array for name, array in self._data.items() if name.startswith(FILTER)}

    def true_measurement(self, k: int) -> Measured:
        """Return what perfect sensors of f_e and of the image features would have shown at sample k."""
        return true_measurement(self._data, k)

    # --- derived ------------------------------------------------------------------------------------

    @property
    def kinetic_energy(self) -> Array:
        """½q̇ᵀM q̇ of the plant, shape (N,) [J]."""
        return self._column("kinetic_energy")

    @property
    def potential_energy(self) -> Array:
        """V(q) of the plant, shape (N,) [J]."""
        return self._column("potential_energy")

    @property
    def storage(self) -> Array:
        """H_d, the controller's storage function, shape (N,) [J]."""
        return self._column("storage")

    @property
    def dissipated_power(self) -> Array:
        """∇H_dᵀR_d∇H_d: what the promised closed loop dissipates, shape (N,) [W]."""
        return self._column("dissipated_power")

    @property
    def supplied_power(self) -> Array:
        """∇H_dᵀ port f_e: what the external force supplies to H_d, shape (N,) [W]."""
        return self._column("supplied_power")

    @property
    def aging_power(self) -> Array | None:
        """∂H_d/∂t at the same coordinates: what the clock alone adds to H_d, shape (N,) [W].

        None for a law that does not change with time, and of a file that was written without it.
        """
        return self._derived("aging").get("aging_power")

    @property
    def force_output(self) -> Array:
        """portᵀ∇H_d, shape (N, n) [rad/s]: the velocity with which f_e does work on H_d."""
        return self._column("force_output")

    @property
    def friction_power(self) -> Array:
        """q̇ᵀD q̇: what the plant's friction takes, shape (N,) [W]."""
        return self._column("friction_power")

    @property
    def control_power(self) -> Array:
        """yᵀu: what the motors give the plant, shape (N,) [W]."""
        return self._column("control_power")

    @property
    def external_power(self) -> Array:
        """q̇ᵀf_e: what the environment gives the plant, shape (N,) [W]."""
        return self._column("external_power")

    @property
    def contact_force(self) -> Array:
        """Sum of the bodies' contact forces, shape (N,) [N, or N·m at a joint]."""
        return self._column("contact_force")

    @property
    def contact_forces(self) -> Array:
        """Contact force of each body, shape (N, bodies) [N, or N·m at a joint]."""
        return self._column("contact_forces")

    @property
    def contact_depths(self) -> Array:
        """How far each body's surface is pushed in, shape (N, bodies) [m or rad]."""
        return self._column("contact_depths")

    @property
    def goal(self) -> Array | None:
        """The posture that the law brings the arm to, shape (N, n) [rad]; None for a law that has none."""
        return self._derived("goal").get("goal")

    @property
    def tank_level(self) -> Array | None:
        """Energy in the law's tank, shape (N,) [J]; None for a law without one."""
        return self._derived("tank").get("tank_level")

    @property
    def wrench_forces(self) -> Array:
        """Force of each external wrench in the world's axes, shape (N, wrenches, 3) [N]."""
        return self._derived("wrenches").get("wrench_forces", np.zeros((len(self.time), 0, 3)))

    @property
    def contact_energy(self) -> Array:
        """Energy stored in the bodies and contacts, shape (N,) [J]."""
        return self._column("contact_energy")

    @property
    def contact_power(self) -> Array:
        """Power dissipated in the bodies and contacts, shape (N,) [W]."""
        return self._column("contact_power")

    def frame(self, name: str) -> FrameMotion:
        """Return how a frame moved, what acted on it and how near to singular the arm was, at every sample.

        Of a log that was read from a file, of the arm that the file describes.

        Raises UnknownNameError for a frame that the arm does not have, PHControlError where a file cannot describe it.
        """
        plant = plant_from_record(self.metadata) if self._loop is None else self._loop.plant
        end = len(self)
        return FrameMotion(plant, name, self.position[:end], self.velocity[:end], self.external_force[:end])

    @property
    def saturated(self) -> Array:
        """Where a torque limit acted, shape (N,), True or False."""
        limit = None if self._loop is None else self._loop.torque_limit
        stored = self.metadata.get("torque_limit")
        limit = np.array(stored, dtype=float) if limit is None and stored is not None else limit
        if limit is None:
            return np.zeros(len(self.time), dtype=bool)
        return np.asarray((np.abs(self.torque) >= limit).any(axis=1))

    def _derived(self, *parts: str) -> dict[str, Array]:
        """Return the quantities of some parts of ``DERIVED``, by default of all: computed now, or before."""
        missing = (PARTS if not parts else frozenset(parts)) - self._known
        if missing:
            self._columns |= derive(self._samples(), names_of(*missing))
            self._known |= missing
            for array in self._data.values():
                array.flags.writeable = False  # what follows from the samples is kept, so they may change no more
        return {name: self._columns[name] for name in names_of(*parts) if name in self._columns}

    def _column(self, name: str) -> Array:
        return self._derived(DERIVED[name].part)[name]

    def _samples(self) -> Iterator[Sample]:
        loop = self._closed_loop()
        if self._length < len(self.time):
            raise PHControlError("the run is still going on: use derive(k) for the energies of one sample")
        if len(self) == 0:
            raise PHControlError("this log holds no sample")
        return (Sample(self._data, k, loop.plant, loop) for k in range(len(self)))

    def _closed_loop(self) -> ClosedLoop:
        if self._loop is None:
            raise PHControlError("this log has no energies and no closed loop to derive them from")
        return self._loop

    def _mechanical(self) -> dict[str, Array]:
        """Return energies and powers of the arm, from the samples: never those that a file holds."""
        if self._loop is not None:
            return self._derived("arm")
        if self._arm is None:
            plant = plant_from_record(self.metadata)
            self._arm = derive((Sample(self._data, k, plant, None) for k in range(len(self))), names_of("arm"))
        return self._arm

    def row(self, k: int) -> dict[str, Any]:
        """Return energies, powers, contact forces and goal at sample k, and velocities, torques and forces."""
        row = {name: array[k] for name, array in self._derived().items()}
        return row | self._recorded(k)

    def derive(self, k: int) -> dict[str, Any]:
        """Compute what ``row`` returns at one sample alone, of a run that is still going on.

        Raises PHControlError for a log that was read from a file without them.
        """
        loop = self._closed_loop()
        sample = Sample(self._data, k, loop.plant, loop)
        row = {name: quantity.compute(sample) for name, quantity in DERIVED.items()}
        row = {name: value for name, value in row.items() if value is not None}
        return row | self._recorded(k)

    def _recorded(self, k: int) -> dict[str, Any]:
        """Return what a viewer wants of the samples themselves."""
        names = ("velocity", "torque", "external_force", *(["features"] if "features" in self._data else []))
        return {name: self._data[name][k] for name in names}

    def power_balance(self, of: str = "storage") -> PowerBalance:
        """Recompute the rate of an energy from the samples and set it against its parts.

        ``of="storage"`` checks the closed loop: Ḣ_d = supplied_power − dissipated_power + ∂H_d/∂t, the promise of the
        law; the last, at the same coordinates, is there of a law that changes with time. A held (sampled) or saturated
        torque is not the law's; what that costs shows as residual.
        ``of="plant"`` checks the arm alone: Ḣ = yᵀu + q̇ᵀf_e − q̇ᵀD q̇, whatever the torque.
        ``of="all"`` checks arm and touched bodies together, whose contact forces are inner ones.
        The residual is of the order of dt⁴ where everything is smooth, and larger where a force jumps.

        Of a log that was read from a file, energies and powers of the arm are computed anew from positions,
        velocities and torques, with the arm that the file describes. H_d and what the bodies store are the
        file's own: their law and their shapes are not in it.

        Raises PHControlError for fewer than five samples, and where a file cannot describe its arm (friction or
        potentials of the user's own).
        """
        choice("energy", of, ("storage", "plant", "all"))
        by_clock = None
        if of == "storage":
            of_law = self._derived("storage", "promise")
            stored, supplied, lost = of_law["storage"], of_law["supplied_power"], of_law["dissipated_power"]
            by_clock = self.aging_power
        else:
            arm = self._mechanical()
            stored = arm["kinetic_energy"] + arm["potential_energy"]
            supplied, lost = arm["control_power"] + arm["external_power"], arm["friction_power"]
        if of == "all":
            stored, supplied = stored + self.contact_energy, supplied - self._column("contact_work")
            lost = lost + self.contact_power
        if len(stored) < 5:
            raise PHControlError("a power balance needs at least five samples")
        step = self.time[1] - self.time[0]
        rate = (8.0 * (stored[3:-1] - stored[1:-3]) - (stored[4:] - stored[:-4])) / (12.0 * step)
        inner = slice(2, -2)
        aging = np.zeros_like(stored) if by_clock is None else by_clock
        return PowerBalance(self.time[inner], rate, supplied[inner], lost[inner], aging[inner])

    # --- files --------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str], *, at_once: bool = False) -> Path:
        """Write the log with its energies to an ``.npz`` file, atomically, with a hash over all of it.

        Args:
            path: of the file.
            at_once: leave out what takes time: energies and all else that follows from the samples are NaN in the
                file, its metadata says so (``"derived": False``), and nothing is compressed. What was interrupted is
                written so.

        Raises DataFileError when it cannot be written, or holds no sample.
        """
        if len(self) == 0:
            raise DataFileError(f"cannot write {path}: this log holds no sample")
        metadata = dict(self.metadata)
        if self._loop is not None:
            limit = self._loop.torque_limit
            if limit is not None:
                metadata["torque_limit"] = [value if np.isfinite(value) else 1e300 for value in limit.tolist()]
            metadata["plant"] = plant_record(self._loop.plant)
        if not at_once:
            return write_log(path, self._data | self._derived(), metadata)
        first = derive(itertools.islice(self._samples(), 1), [name for name in DERIVED if name not in OPTIONAL])
        blank = {name: np.full((len(self), *row.shape[1:]), np.nan) for name, row in first.items()}
        return write_log(path, self._data | blank, metadata | {"derived": False}, compress=False)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, largest: int = LARGEST) -> Log:
        """Read a log that ``save`` wrote; nothing in the file is executed, and nothing that it names is opened.

        A file whose content is not what its hash says is refused; so is a log of an older format, which has none.
        The hash finds what was changed by mistake or by hand, not who wrote the file: whoever computes it anew can
        write any log. See ``power_balance`` for what is recomputed.

        Args:
            path: of the file.
            largest: bytes that it may unpack to; a longer log of one's own is read with more.

        Raises DataFileError.
        """
        data, metadata = read_log(path, largest)
        log = cls(data, metadata)
        log.path = Path(path)
        return log

    @property
    def plot(self) -> Any:
        """Plots of the run (needs matplotlib): ``log.plot.position()``, ``log.plot()``; see ``LogPlots``."""
        # by name: the way of the data goes from a log to its pictures
        return import_module("phcontrol.visualization.log_plots").LogPlots(self)

    @property
    def signals(self) -> Signals:
        """The run's signals and energies, for other programs."""
        names = tuple(self.metadata["joint_names"])
        units = {"position": "rad", "velocity": "rad/s", "torque": "N·m", "external_force": "N·m"}
        quantities = {name: Signal(self._data[name], unit, names) for name, unit in units.items()}
        if self.controller_state.size:
            quantities["controller_state"] = Signal(self.controller_state, "1")
        for name, column in self._derived().items():
            if DERIVED[name].shape == ():
                quantities[name] = Signal(column, "W" if name.endswith("power") else "J")
        kept = ("robot", "controller", "interconnection", "dt", "integrator", "control_period")
        return Signals(self.time, quantities, {name: self.metadata.get(name) for name in kept})

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the log as a pandas DataFrame indexed by time (needs pandas)."""
        try:
            import pandas
        except ImportError as error:
            raise PHControlError("to_dataframe needs pandas: pip install pandas") from error
        columns: dict[str, Array] = {}
        names = self.metadata["joint_names"]
        for quantity in ("position", "velocity", "torque", "external_force"):
            columns |= {f"{quantity}/{name}": self._data[quantity][:, i] for i, name in enumerate(names)}
        if "features" in self._data:
            columns |= {f"features/{name}": self.features[:, i] for i, name in enumerate(("mu", "nu", "length"))}
        columns |= {f"controller_state/{i}": column for i, column in enumerate(self.controller_state.T)}
        columns |= {name: column for name, column in self._derived().items() if DERIVED[name].shape == ()}
        return pandas.DataFrame(columns, index=pandas.Index(self.time, name="time"))
