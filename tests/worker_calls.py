"""What the tests ask a worker process to do besides simulating a scene."""

import os
import time

from circuits.equivalent import compact_model
from circuits.equivalent.assembly import Netlist, assemble
from circuits.ngspice import compiled_device
from circuits.ngspice.session import session
from harvester.base import numba_cache
from harvester.base.errors import SimulatorAborted
from harvester.engines.methods import engine_of
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import steps_per_sample
from harvester.validation import throughput


def say(report, text):
    return text.upper()


def wait(report, seconds):
    report("waiting")
    time.sleep(seconds)
    report("waited")


def wait_silently(report, seconds):
    time.sleep(seconds)


def compile_slowly(report, seconds):
    """A compilation within another one, which takes this long."""
    numba_cache.on_compilation(1)
    numba_cache.on_compilation(1)
    numba_cache.on_compilation(-1)
    time.sleep(seconds)
    numba_cache.on_compilation(-1)
    return "compiled"


def die(report, status):
    os._exit(status)


def die_once(report, marker):
    if not os.path.exists(marker):
        with open(marker, "w"):
            os._exit(5)
    return "alive"


def die_unless(report, marker):
    if not os.path.exists(marker):
        os._exit(4)
    return "alive"


def fail(report, reason):
    raise SimulatorAborted(reason)


def speeds(report, prepared_scene):
    """The throughput of a scene, in this process."""

    class Here:
        def map(self, function, calls):
            return [function(report=report, **call) for call in calls]

    rows = throughput.measure(prepared_scene, Here(), compiled=False, knots=200, repeats=1)
    return {"rows": rows, "machine": {"date": "today", "cores": 1, "processor": "this one"}}


def run_text(report, text, stop):
    """Run a netlist with the noise of `paper` on its external source."""
    scene = Scene.read("paper")
    ready = prepared(scene)
    parameters = ready.system
    from truths import Keep

    keep = Keep()
    netlist = Netlist(text, 1.0, 1.0, 0.05, stop)
    steps = session().run(netlist, parameters, [noise_path(ready, 0)], [[keep]], 1)
    return steps, keep.record()


def load_compiled_device(report):
    compiled_device.load(
        session(), compact_model.module_of(prepared(Scene.read("paper")).system)[1]
    )


def run_device(report, scene, compiled, copies=1):
    """Record of the last of a scene's copies, a row a quantity, its mechanics compiled or not."""
    from truths import Keep

    ready = prepared(scene)
    parameters = ready.system
    if compiled:
        text = compact_model.module_of(parameters)[1]
        compiled_device.load(session(), text)
        compiled_device.load(session(), text)  # a second time does no harm
    starts = [start_state(ready, index) for index in range(copies)]
    netlist = assemble(prepared(scene), starts=starts, compiled=compiled)
    keep = [Keep() for _ in starts]
    paths = [noise_path(ready, index) for index in range(copies)]
    session().run(netlist, parameters, paths, [[each] for each in keep], steps_per_sample(ready))
    return keep[-1].record()


def resident_megabytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def run_many(report, scene, times):
    """Memory after the first and after the last of many runs (MB)."""
    from truths import Keep

    from harvester.engines.methods import Circuit

    sizes = []
    ready = prepared(scene)
    for index in range(times):
        starts = [start_state(ready, 0)]
        Circuit().run_realizations(ready, [noise_path(ready, 0)], starts, [[Keep()]])
        if index in (times // 4, times - 1):
            sizes.append(resident_megabytes())
    return sizes


def run_long(report, scene):
    """Growth of memory over the second half of one run (MB)."""
    from harvester.engines.methods import Circuit

    class Watch:
        def __init__(self):
            self.sizes = []

        def add(self, record):
            self.sizes.append(resident_megabytes())

    watch = Watch()
    ready = prepared(scene)
    starts = [start_state(ready, 0)]
    Circuit().run_realizations(ready, [noise_path(ready, 0)], starts, [[watch]])
    return watch.sizes[-1] - watch.sizes[len(watch.sizes) // 2]


def drop(report, scene, speed, step):
    """Throw the mass at the right stopper, in the circuit; the record of what follows."""
    import dataclasses
    import re

    from truths import Keep

    from circuits.equivalent.assembly import assemble
    from harvester.scene.steps import steps_per_sample

    ready = prepared(scene)
    parameters = ready.system
    netlist = assemble(prepared(scene), step)
    start = repr(speed / netlist.rate)
    text, found = re.subn(r"(?m)^(Cmass .*ic=)0\.0$", rf"\g<1>{start}", netlist.text)
    assert found == 1
    keep = Keep()
    netlist = dataclasses.replace(netlist, text=text)
    steps = steps_per_sample(ready, step)
    session().run(netlist, parameters, [noise_path(ready, 0)], [[keep]], steps)
    return keep.record()


def stick(report, scene):
    """Start a scene's run with an impact speed of zero held in contact, which is dry friction."""
    import dataclasses
    import re

    ready = prepared(scene)
    parameters = ready.system
    netlist = assemble(prepared(scene))
    text, found = re.subn(r"(?m)^(Cheld_speed .*ic=).*$", r"\g<1>0.0", netlist.text)
    assert found == 1
    netlist = dataclasses.replace(netlist, text=text)
    paths = [noise_path(ready, 0)]
    session().run(netlist, parameters, paths, [[]], steps_per_sample(ready))


def run_with_law(report, tables, engine, step):
    """(X, X', V) at the knots of a scene whose contacts have the law of `spring_dashpot`."""
    from spring_dashpot import spring_dashpot
    from truths import Keep

    from harvester.device.contact import LAWS
    from harvester.scene.steps import knot_spacing

    LAWS["dashpot"] = spring_dashpot
    scene = Scene.from_tables(tables)
    ready = prepared(scene)
    keep = Keep()
    chosen = engine_of(engine, step=step, device="behavioural")
    chosen.prepare(ready)
    chosen.run_realizations(ready, [noise_path(ready, 0)], [start_state(ready, 0)], [[keep]])
    return keep.at_knots(knot_spacing(ready))
