"""One ngspice library in this process: loads a netlist, runs it, streams its solution.

Runs in a worker process of its own (`harvester.workers`), because some mistakes make ngspice
abort or hang. PySpice loads the library and sends the commands; its callbacks are replaced by
the compiled ones of `circuits.callbacks`.
"""

import os
import re
import sys

import numpy as np
from PySpice.Spice.NgSpice.Shared import NgSpiceCommandError, NgSpiceShared, ffi

from circuits import callbacks, elements
from circuits.library import find_library
from harvester.compilation import compiled
from harvester.errors import SimulatorAborted, SolutionDiverged
from harvester.parameters import ScaledParameters
from harvester.record import empty_record, fill, part

# ngspice's name of each column of the buffer.
VECTORS = (
    "time",
    elements.DISPLACEMENT,
    elements.VELOCITY,
    elements.PIEZO,
    elements.NOISE,
    elements.HELD,
    elements.LOAD_CURRENT,
    elements.OUTPUT,
    elements.REFERENCE,
)

# What ngspice prints when a run went wrong, on either stream.
TROUBLE = re.compile(
    r"error|too small|unrecognized|singular|abort|no such|unknown|fatal|can't|cannot|failed|"
    r"not found",
    re.IGNORECASE,
)
HARMLESS = re.compile(r"can't find (the )?(init|initialization) file|Cannot open display", re.I)

_session = None


def session():
    """The process's only session, opened when first asked for.

    Raises
    ------
    EngineNotFound
    """
    global _session
    if _session is None:
        NgSpiceShared.LIBRARY_PATH = find_library().replace("{", "{{").replace("}", "}}")
        _session = Session()
    return _session


@compiled
def _convert(p, nodes, record, rate, square_rate, per_volt, per_power):
    """Node values, shape (n, COLUMNS), to a record in scaled units.

    `per_power` is 0 where the load is the built-in resistor, whose power `fill` knows.
    """
    for row in range(nodes.shape[0]):
        fill(
            p,
            record,
            row,
            nodes[row, callbacks.TIME],
            nodes[row, callbacks.DISPLACEMENT],
            nodes[row, callbacks.VELOCITY] * rate,
            nodes[row, callbacks.PIEZO] * per_volt,
            nodes[row, callbacks.NOISE] * square_rate,
            nodes[row, callbacks.HELD] * rate,
        )
        if per_power > 0.0:
            volts, current = nodes[row, callbacks.PIEZO], nodes[row, callbacks.LOAD_CURRENT]
            record.load_power[row] = volts * current * per_power


class Session(NgSpiceShared):
    """PySpice's shared ngspice with compiled callbacks."""

    def _init_ngspice(self, send_data):
        self.state = np.zeros(1, dtype=callbacks.STATE)
        self.messages = []
        self._service = None
        self._keep = [
            ffi.callback("int (char *, int, void *)", self._receive_message),
            ffi.callback("int (char *, int, void *)", lambda *_: 0),
            ffi.callback("int (int, bool, bool, int, void *)", self._exited),
            ffi.cast("SendData *", callbacks.send_data.address),
            ffi.callback("int (pvecinfoall, int, void *)", self._receive_vectors),
            ffi.callback("int (bool, int, void *)", lambda *_: 0),
        ]
        user = ffi.cast("void *", self.state.ctypes.data)
        self._ngspice_shared.ngSpice_Init(*self._keep, user)
        self._identity = ffi.new("int *", 0)
        self._ngspice_shared.ngSpice_Init_Sync(
            ffi.cast("GetVSRCData *", callbacks.get_noise.address),
            ffi.NULL,
            ffi.cast("GetSyncData *", callbacks.set_step.address),
            self._identity,
            user,
        )
        service = ffi.callback("int (int)", self._serve)
        self._keep.append(service)
        self.state["service"] = int(ffi.cast("intptr_t", service))
        self.version_text = self.exec_command("version -f")
        self.exec_command("set nomoremode")
        # Newer releases read a system file at every step otherwise.
        self.exec_command("set no_mem_check")
        self.exec_command("set num_threads=1")

    def prepare(self):
        """Load the compiled code that the first point would wait for."""
        nothing = ScaledParameters(*[1.0] * 6, False, *[1.0] * 4)
        _convert(nothing, np.zeros((0, callbacks.COLUMNS)), empty_record(0), 1.0, 1.0, 1.0, 0.0)

    def run(
        self, netlist, parameters, path, observers, steps_per_knot, local_error=False, output=None
    ):
        """Run one transient and hand its record to the observers.

        Parameters
        ----------
        netlist : circuits.assembly.Netlist
        parameters : ScaledParameters
        path : NoisePath or None
            Feeds the external source; None when the netlist holds its own source.
        observers : sequence of objects with `add(record)`
        steps_per_knot : int
            Steps between knots; 0 leaves the steps to ngspice.
        local_error : bool
            Between knots, ngspice's own step is taken where it is shorter.
        output : harvester.output_moments.OutputMoments or None
            For a load that has an output side.

        Returns
        -------
        int
            Accepted steps.

        Raises
        ------
        SimulatorAborted, SolutionDiverged
        """
        self._begin(netlist, parameters, path, observers, steps_per_knot)
        self._output = output
        self.state["local_error"] = local_error
        try:
            self._load(netlist.text)
            self._command("run")
            self._flush()
            self._check_end(netlist.stop)
            if output is not None:
                self._measure_output(netlist, output)
        finally:
            self._service = None
            for command in ("remcirc", "destroy all"):
                try:
                    self.exec_command(command)
                except NgSpiceCommandError:
                    continue
        return int(self.state["steps"][0])

    def _begin(self, netlist, parameters, path, observers, steps_per_knot):
        self.messages = []
        self._netlist, self._parameters = netlist, parameters
        self._path, self._observers = path, observers
        self._record = empty_record(callbacks.BUFFER)
        self._time_reached = 0.0
        self._finite = True
        state = self.state[0]
        state["count"] = state["steps"] = state["first_knot"] = 0
        state["spacing"] = path.spacing if path else np.inf
        state["steps_per_knot"] = steps_per_knot
        state["parameters"][:] = parameters
        state["rate"] = netlist.rate
        state["voltage_scale"] = netlist.voltage_scale
        if path:
            state["window"][:] = path.read(callbacks.WINDOW) / netlist.rate**2
        self._service = (self._flush, self._move_window)

    def _serve(self, reason):
        """Called by the compiled callbacks; an error must not return into ngspice."""
        try:
            self._service[reason]()
        except BaseException as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
            os._exit(70)
        return 0

    def _flush(self):
        """Turn the buffered node values into a record and hand it on."""
        state = self.state[0]
        count = int(state["count"])
        if count == 0:
            return
        nodes = state["buffer"][:count]
        rate = self._netlist.rate
        start = 1 if nodes[0, callbacks.TIME] == 0.0 else 0
        _convert(
            self._parameters,
            nodes[start:],
            self._record,
            rate,
            rate * rate,
            1.0 / self._netlist.voltage_scale,
            self._netlist.per_power,
        )
        state["count"] = 0
        self._finite = self._finite and bool(np.isfinite(nodes).all())
        if not self._finite:
            return
        self._time_reached = float(nodes[-1, callbacks.TIME])
        chunk = part(self._record, 0, count - start)
        for observer in self._observers:
            observer.add(chunk)
        if self._output is not None:
            volts = nodes[start:, callbacks.OUTPUT] - nodes[start:, callbacks.REFERENCE]
            volts /= self._netlist.voltage_scale
            self._output.add(nodes[start:, callbacks.TIME], volts)

    def _measure_output(self, netlist, output):
        """Conductance and capacitance across the output, scaled, as ngspice evaluated them."""
        scale = netlist.per_power * netlist.voltage_scale**2
        resistances = [self._property(name, "resistance") for name in netlist.output_resistors]
        output.conductance = scale * sum(1.0 / resistance for resistance in resistances)
        farads = sum(self._property(name, "capacitance") for name in netlist.storage)
        output.capacitance = scale * farads

    def _property(self, device, name):
        vector = self._ngspice_shared.ngGet_Vec_Info(f"@{device}[{name}]".encode())
        if vector == ffi.NULL or vector.v_realdata == ffi.NULL:
            return np.nan
        return float(vector.v_realdata[0])

    def _move_window(self):
        """Drop the knots that are past and read as many new ones."""
        state = self.state[0]
        passed = callbacks.WINDOW - 2 * callbacks.MARGIN
        window = state["window"]
        window[: 2 * callbacks.MARGIN] = window[passed:].copy()
        window[2 * callbacks.MARGIN :] = self._path.read(passed) / self._netlist.rate**2
        state["first_knot"] += passed

    def _load(self, text):
        self._stdout, self._stderr = [], []
        lines = [ffi.new("char[]", line.encode()) for line in [*text.splitlines(), ".end", ""]]
        self._ngspice_shared.ngSpice_Circ(ffi.new("char *[]", [*lines, ffi.NULL]))
        trouble = self._trouble()
        if trouble:
            raise SimulatorAborted(f"ngspice refused the netlist: {trouble}")

    def _command(self, command):
        try:
            self.exec_command(command)
        except (NgSpiceCommandError, NameError):
            raise SimulatorAborted(self._abort_message()) from None

    def _abort_message(self):
        trouble = self._trouble() or "it gave no reason"
        return f"ngspice stopped at t = {self._time_reached:g}: {trouble}"

    def _check_end(self, stop):
        if not self._finite:
            raise SolutionDiverged(
                f"ngspice returned values that are not finite after t = {self._time_reached:g}"
            )
        if self._time_reached < stop * (1.0 - 1e-9):
            trouble = self._trouble()
            if trouble:
                raise SimulatorAborted(self._abort_message())
            raise SolutionDiverged(
                f"ngspice ended at t = {self._time_reached:g} of {stop:g} without a message"
            )

    def _trouble(self):
        """ngspice's own words about what went wrong, in one line."""
        lines = [
            line for line in self.messages if TROUBLE.search(line) and not HARMLESS.search(line)
        ]
        return "; ".join(dict.fromkeys(line.strip() for line in lines[:4]))

    def _receive_message(self, message, identity, user):
        stream, _, content = ffi.string(message).decode(errors="replace").partition(" ")
        self.messages.append(content)
        if stream == "stderr":
            self._stderr.append(content)
            print(content, file=sys.stderr, flush=True)
        else:
            self._stdout.append(content)
        return 0

    def _receive_vectors(self, data, identity, user):
        names = [ffi.string(data.vecs[k].vecname).decode() for k in range(data.veccount)]
        self.state["vectors"][0] = [names.index(n) if n in names else -1 for n in VECTORS]
        return 0

    def _exited(self, status, immediate, quit_requested, identity, user):
        """ngspice wants to leave the process: let it, with its last words on stderr."""
        os._exit(71)
