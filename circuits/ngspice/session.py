"""One ngspice library in this process: loads a netlist, runs it, streams its solution.

Runs in a separate worker process (`harvester.base.worker_process`), because some mistakes make
ngspice abort or hang. PySpice loads the library and sends the commands; its callbacks are replaced
by the compiled ones of `circuits.ngspice.callbacks`.

    Session.run          ngspice                   compiled callbacks
    ───────────          ───────                   ──────────────────
    _begin, _load   →    a transient begins
                         next time point      ←    _set_step: length of the step
                         value of the source  ←    get_noise: linear between samples
                         accepts the point    →    send_data: one row of the buffer
    _flush          ←─────────────────────────────  buffer full: rows → record → observers
    _move_window    ←─────────────────────────────  samples used up: the next ones
    _watch, each second: chatter, runaway, no progress
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from PySpice.Spice.NgSpice.Shared import NgSpiceCommandError, NgSpiceShared, ffi

from circuits.equivalent import compact_model, elements
from circuits.netlist.load_notes import suspicion
from circuits.netlist.part_values import SOURCE_CURE, jumping_sources
from circuits.netlist.source_schedule import AHEAD
from circuits.ngspice import callbacks, compiled_device, messages
from circuits.ngspice.chatter import Chattering
from circuits.ngspice.library import code_models, find_library, no_initialisation_files
from circuits.ngspice.solution import convert, units_of, vectors
from harvester.base.compilation import numbers_of
from harvester.base.errors import (
    CompiledDeviceUnavailable,
    LoadChatters,
    NotConverged,
    SimulatorAborted,
    SolutionDiverged,
)
from harvester.base.worker_main import as_answer, give_up
from harvester.device import timescales
from harvester.device.record import empty_record, part
from harvester.scene.steps import (
    CRAWL,
    LARGEST_VOLTAGE,
    PATIENCE,
    RUNAWAY,
    STALLED,
    STEPS_PER_CONTACT,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from circuits.equivalent.assembly import Netlist
    from harvester.device.system import System
    from harvester.excitation.base import ExcitationPath
    from harvester.statistics.output_moments import OutputMoments

# Accuracy of the beginning of a contact, from which the impact speed is held, as a share of the
# contact's step.
LANDING = 1.0 / 32.0

# The voltage of charge moved by the base follows the excitation's slope, which jumps at each
# sample. If this voltage decays within a step, the trapezoidal rule rings: powers were up to 11
# times too high. If the error exceeds RINGING, steps double after each sample, starting from
# SETTLED of the decay time.
RINGING, SETTLED = 0.01, 0.25

_session = None


def session() -> Session:
    """The process's only session, opened at the first call.

    Raises
    ------
    EngineNotFound
    """
    global _session
    if _session is None:
        NgSpiceShared.LIBRARY_PATH = find_library().replace("{", "{{").replace("}", "}}")
        _session = Session()
    return _session


class Session(NgSpiceShared):
    """PySpice's shared ngspice with compiled callbacks.

    Attributes
    ----------
    circuit_load : circuits.netlist.load_circuit.LoadCircuit or None
        The load of the present netlist, for names in messages.
    """

    circuit_load = None

    def _init_ngspice(self, send_data):
        self.state = np.zeros(1, dtype=callbacks.STATE)
        self.messages, self.errors = [], []
        self._compiled_devices = {}
        self._doing = "stopped"
        self._service: tuple[Callable[[], None], ...] | None = None
        self._keep = [
            ffi.callback("int (char *, int, void *)", self._receive_message),
            ffi.callback("int (char *, int, void *)", lambda *_: 0),
            ffi.callback("int (int, bool, bool, int, void *)", self._exited),
            ffi.cast("SendData *", callbacks.send_data.address),
            ffi.callback("int (pvecinfoall, int, void *)", self._receive_vectors),
            ffi.callback("int (bool, int, void *)", lambda *_: 0),
        ]
        user = ffi.cast("void *", self.state.ctypes.data)
        self._started = False
        with no_initialisation_files():
            self._ngspice_shared.ngSpice_Init(*self._keep, user)
        self._started = True
        self._identity = ffi.new("int *", 0)
        service = ffi.callback("int (int)", self._serve)
        self._keep.append(service)
        self.state["service"] = int(ffi.cast("intptr_t", service))
        for model in code_models(self.library_path):
            # ngspice splits its commands at blanks, quoted or not.
            with contextlib.chdir(model.parent):
                self.exec_command(f"codemodel ./{model.name}")
        self.version_text = self.exec_command("version -f")
        self.exec_command("set nomoremode")
        # Otherwise newer releases would read a system file at every step.
        self.exec_command("set no_mem_check")
        self.exec_command("set num_threads=1")

    def compiled_device_is_off(self, system: System) -> str:
        """Reason why there is no compiled device with these parts; empty if it is loaded."""
        try:
            name, text = compact_model.module_of(system)
        except CompiledDeviceUnavailable as reason:
            return str(reason)
        if name not in self._compiled_devices:
            try:
                compiled_device.load(self, text)
                self._compiled_devices[name] = ""
            except CompiledDeviceUnavailable as reason:
                self._compiled_devices[name] = str(reason)
        return self._compiled_devices[name]

    def prepare(self, system: System) -> None:
        """Load the compiled code that the first point of this device needs."""
        nodes = np.zeros((0, callbacks.COLUMNS))
        record = empty_record(0)
        convert(system, np.zeros(2), np.zeros(0), nodes, record, 1.0, (1.0,) * 4)
        callbacks.step_setter(system)

    def run(
        self,
        netlist: Netlist,
        system: System,
        paths: Sequence[ExcitationPath],
        observers: Sequence[Sequence[Any]],
        steps_per_sample: int,
        steps_per_contact: int = STEPS_PER_CONTACT,
        local_error: bool = False,
        refinement: float = 1.0,
        outputs: Sequence[OutputMoments] | None = None,
    ) -> int:
        """Run one transient and hand its records to the observers.

        Parameters
        ----------
        netlist : circuits.equivalent.assembly.Netlist
        system : harvester.device.system.System
        paths : sequence of ExcitationPath
            One for each copy of the device in the netlist.
        observers : sequence of sequences of objects with `add(record)`
            Observers of each copy.
        steps_per_sample : int
            Steps between knots; 0 leaves the steps to ngspice.
        steps_per_contact : int
            Fewest steps from the beginning of a contact to its end.
        local_error : bool
            Whether ngspice's step is used if it is shorter.
        refinement : float
            Divisor of the default step.
        outputs : sequence of harvester.statistics.output_moments.OutputMoments or None
            One per copy, for a load with an output.

        Returns
        -------
        int
            Accepted steps.

        Raises
        ------
        SimulatorAborted, SolutionDiverged
        """
        self._begin(netlist, system, paths, observers)
        self._outputs = outputs
        self.state["steps_per_sample"] = steps_per_sample
        self.state["steps_per_contact"] = steps_per_contact
        self.state["local_error"] = local_error
        self.state["refinement"] = max(refinement, 1.0)
        try:
            self._load(netlist.text)
            with self._watched():
                try:
                    self.exec_command("run")
                except (NgSpiceCommandError, NameError):
                    raise self._abortion() from None
            self._flush()
            self._check_end(netlist.stop)
            scale = netlist.per_power * netlist.voltage_scale**2
            for output in outputs or ():
                output.conductance = scale * netlist.conductance
        finally:
            self._service = None
            for command in ("remcirc", "destroy all"):
                with contextlib.suppress(NgSpiceCommandError):
                    self.exec_command(command)
        return int(self.state["steps"][0])

    def _begin(self, netlist, system, paths, observers):
        self.messages, self.errors = [], []
        self._netlist, self._system = netlist, system
        self._paths, self._observers = paths, observers
        self._time_reached = 0.0
        self._finite = True
        copies = len(paths)
        points = max(callbacks.BUFFERED_POINTS // copies, callbacks.FEWEST_POINTS)
        knots = max(callbacks.BUFFERED_KNOTS // copies, callbacks.FEWEST_KNOTS)
        self._record = empty_record(points)
        measured = callbacks.COLUMNS + len(netlist.measurement.watched)
        columns = measured + len(netlist.watch.unknowns)
        self._vectors = np.full((copies, columns), -1)
        self._times = np.zeros(points)
        self._buffer = np.zeros((copies, points, columns))
        self._window = np.array([path.read(knots) for path in paths]) / netlist.rate**2
        state = self.state[0]
        state["copies"], state["points"], state["knots"] = copies, points, knots
        state["columns"] = columns
        for name in ("vectors", "times", "buffer", "window"):
            state[name] = getattr(self, f"_{name}").ctypes.data
        state["count"] = state["steps"] = state["first_knot"] = 0
        state["spacing"] = paths[0].spacing
        self._numbers = np.array(numbers_of(system))
        self._free = np.array(timescales.free_zone(system))
        state["system"] = self._numbers.ctypes.data
        state["free"][:] = self._free
        state["state_scale"] = 1.0 / netlist.state_unit
        state["landing"] = LANDING if elements.holding(system) else 1.0
        state["rate"] = netlist.rate
        state["pace"], state["line"] = netlist.pace, netlist.line
        self._push = np.zeros(copies)
        state["push"] = self._push.ctypes.data
        state["slowed"] = state["owed"] = 0.0
        decay = system.transducer.decay_rate()
        cost = timescales.base_share(system, paths[0].spacing) * 0.5 * decay * netlist.step
        state["settling"] = SETTLED / decay if cost > RINGING else 0.0
        self._begin_watching(netlist, copies, measured)
        self._begin_planning(netlist)
        self._ngspice_shared.ngSpice_Init_Sync(
            ffi.NULL,
            ffi.cast("GetISRCData *", callbacks.get_noise.address),
            ffi.cast("GetSyncData *", callbacks.step_setter(system)),
            self._identity,
            ffi.cast("void *", self.state.ctypes.data),
        )
        self._service = (self._flush, self._move_window, self._plan_ahead)

    def _begin_watching(self, netlist, copies, first):
        """Set up the watch of the load's switches and stores, from column `first` on."""
        watch, state = netlist.watch, self.state[0]
        switches = np.array(watch.switches, dtype=float).reshape(-1, 3)
        self._switches = switches[:, :2].copy()
        self._stores = np.array(watch.stores, dtype=float).reshape(-1, 2)
        self._memory = np.tile(np.append(switches[:, 2], 0.0), (copies, 1))
        state["first_watched"] = first
        state["switch_count"], state["store_count"] = len(watch.switches), len(watch.stores)
        for name in ("switches", "stores", "memory"):
            state[name] = getattr(self, f"_{name}").ctypes.data
        state["capacitance"], state["least_energy"] = netlist.watched_energy
        state["turn"] = watch.turn

    def _begin_planning(self, netlist):
        """Plan steps for the load's time-varying sources, if there are any."""
        state, schedule = self.state[0], netlist.schedule
        self._moves = schedule.steps(netlist.step) if schedule else None
        self._next_planned = 0
        state["planned_to"] = 0.0 if schedule else np.inf
        state["planned_count"] = state["planned_place"] = 0
        state["jumped"] = state["jump_width"] = 0.0

    def _plan_ahead(self):
        """Plan the next steps of the grid."""
        state = self.state[0]
        assert self._moves is not None
        self._plan = self._moves.plan(self._next_planned, AHEAD)
        self._next_planned += AHEAD
        state["planned_to"] = self._next_planned * self._netlist.step
        state["planned_count"], state["planned_place"] = self._plan.ends.size, 0
        for name, column in self._plan._asdict().items():
            state[f"planned_{name}"] = column.ctypes.data

    def _serve(self, reason):
        """Called by the compiled callbacks; an error must not return into ngspice."""
        try:
            assert self._service is not None
            self._service[reason]()
        except BaseException as error:
            give_up(as_answer(error))
        return 0

    def _flush(self):
        """Convert the buffered node values to records and pass them to the observers."""
        state = self.state[0]
        count = int(state["count"])
        if count == 0:
            return
        state["count"] = 0
        # Points beyond the end of the run are not recorded.
        count = int(np.searchsorted(self._times[:count], self._netlist.stop * (1.0 + 1e-9)))
        if count == 0:
            return
        times, nodes = self._times[:count], self._buffer[:, :count]
        self._finite = self._finite and bool(np.isfinite(nodes).all())
        if not self._finite:
            return
        start = 1 if times[0] == 0.0 else 0
        self._time_reached = float(times[-1])
        if growth := self._unbounded(self._time_reached, nodes):
            # Other options are not tried: Gear's rule would damp a real growth.
            raise SimulatorAborted(growth)
        chunk = part(self._record, 0, count - start)
        rate, units = self._netlist.rate, units_of(self._netlist)
        device = self._system, self._free
        for copy_index, (copy, observers) in enumerate(zip(nodes, self._observers, strict=True)):
            convert(*device, times[start:], copy[start:], self._record, rate, units)
            for observer in observers:
                observer.add(chunk)
            if self._outputs is not None:
                volts = copy[start:, callbacks.OUTPUT] - copy[start:, callbacks.REFERENCE]
                measurement = self._netlist.measurement
                measured = copy[start:, callbacks.COLUMNS :][:, : len(measurement.watched)].T
                values = measurement.values(times[start:], measured, self._netlist.per_power)
                scaled = volts / self._netlist.voltage_scale
                levels = measurement.levels(measured)
                energy = self._netlist.per_power * measurement.energy
                self._outputs[copy_index].add(times[start:], scaled, values, levels, energy)

    @contextlib.contextmanager
    def _watched(self):
        """End a run without progress within the block: ngspice would try endlessly."""
        done = threading.Event()
        threading.Thread(target=self._watch, args=(done,), daemon=True).start()
        try:
            yield
        finally:
            done.set()

    def _watch(self, done):
        spent, reached = time.process_time(), 0.0
        chattering = Chattering(self._netlist, self.circuit_load)
        while not done.wait(1.0):
            count = int(self.state["count"][0])
            latest = float(self._times[count - 1]) if count else self._time_reached
            source = chattering.found(self._times[:count], self._buffer[0, :count])
            if source and not done.is_set():
                self._doing = f"stopped at t = {latest:g}"
                give_up(LoadChatters(self._in_context(f"{source} chatters: {SOURCE_CURE}")))
            growth = self._unbounded(latest, self._buffer[:, :count])
            if growth and not done.is_set():
                give_up(SimulatorAborted(growth))
            if latest - reached > CRAWL * self._netlist.step:
                spent, reached = time.process_time(), latest
            elif not done.is_set() and time.process_time() - spent > PATIENCE:
                self._doing = f"stopped at t = {latest:g}"
                cause = "the cause may be a force or a current that jumps, such as dry friction"
                trouble = f"{STALLED}; {cause}"
                if self.circuit_load and (jumping := jumping_sources(self.circuit_load.elements)):
                    trouble += f"; look at {', '.join(source.place for source in jumping[:3])}"
                give_up(SimulatorAborted(self._in_context(trouble)))

    def _unbounded(self, latest, nodes):
        """Message on a load whose voltage grows without bound; empty for others."""
        if np.abs(nodes[:, :, callbacks.TERMINAL]).max(initial=0.0) <= LARGEST_VOLTAGE:
            return ""
        self._doing = f"stopped at t = {latest:g}"
        return self._in_context(f"{RUNAWAY}{suspicion(self.circuit_load)}")

    def _move_window(self):
        """Discard past knots and read an equal number of new ones."""
        state = self.state[0]
        passed = int(state["knots"]) - 2 * callbacks.KNOTS_KEPT_BEHIND
        for window, path in zip(self._window, self._paths, strict=True):
            window[: 2 * callbacks.KNOTS_KEPT_BEHIND] = window[passed:].copy()
            window[2 * callbacks.KNOTS_KEPT_BEHIND :] = path.read(passed) / self._netlist.rate**2
        state["first_knot"] += passed

    def _load(self, text):
        self._stdout, self._stderr = [], []
        lines = [ffi.new("char[]", line.encode()) for line in [*text.splitlines(), ".end", ""]]
        self._doing = "refused the netlist"
        self._announce("was reading the netlist")
        self._ngspice_shared.ngSpice_Circ(ffi.new("char *[]", [*lines, ffi.NULL]))
        trouble = messages.refusal(self.errors)
        if trouble:
            raise SimulatorAborted(self._in_context(trouble))
        self._doing = "stopped"
        self._announce("was running the netlist")

    def _announce(self, doing):
        """Print ngspice's next action, which the error quotes if ngspice crashes."""
        load = f" with the load {self.circuit_load.file}" if self.circuit_load else ""
        print(f"ngspice {doing}{load}", file=sys.stderr, flush=True)

    def _abortion(self):
        """The exception for a run that ended early: `NotConverged` if other options may help."""
        self._doing = f"stopped at t = {self._time_reached:g}"
        reason = messages.abortion(self.errors)
        advice = messages.advice(reason, self._netlist.drives_current)
        advice = advice or suspicion(self.circuit_load)
        failed = messages.fails_to_converge(reason) and not advice
        return (NotConverged if failed else SimulatorAborted)(self._in_context(reason + advice))

    def _in_context(self, trouble):
        """ngspice's error messages, with names from the load's files."""
        trouble = messages.with_places(trouble or "it gave no reason", self.circuit_load)
        return f"ngspice {self._doing}: {trouble}"

    def _check_end(self, stop):
        if not self._finite:
            raise SolutionDiverged(
                f"ngspice returned values that are not finite after t = {self._time_reached:g}; "
                "choose a shorter step"
            )
        if self._time_reached < stop * (1.0 - 1e-9):
            if messages.abortion(self.errors):
                raise self._abortion()
            raise SolutionDiverged(
                f"ngspice ended at t = {self._time_reached:g} of {stop:g} without a message; "
                "choose a shorter step"
            )

    def _receive_message(self, message, identity, user):
        stream, _, content = ffi.string(message).decode(errors="replace").partition(" ")
        self.messages.append(content)
        if stream == "stderr":
            self._stderr.append(content)
            self.errors.append(content)
            if self._started:
                print(content, file=sys.stderr, flush=True)
        else:
            self._stdout.append(content)
        return 0

    def _receive_vectors(self, data, identity, user):
        """Indices of the nodes of each copy among ngspice's vectors."""
        names = [ffi.string(data.vecs[k].vecname).decode().lower() for k in range(data.veccount)]
        indices = {name: k for k, name in enumerate(names)}
        self.state["time_vector"] = indices["time"]
        for copy, names_of_copy in enumerate(vectors(self._netlist)):
            self._vectors[copy] = [indices.get(name, -1) for name in names_of_copy]
        return 0

    def _exited(self, status, immediate, quit_requested, identity, user):
        """Callback for ngspice's exit: end this process with ngspice's messages as the error."""
        words = messages.refusal(self.errors) or messages.abortion(self.errors)
        give_up(SimulatorAborted(self._in_context(words)))
