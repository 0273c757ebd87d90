"""Writes Functional Mock-up Units for co-simulation, FMI 2.0 and 3.0, with sources."""

from __future__ import annotations

import hashlib
import io
import platform
import re
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from xml.sax.saxutils import quoteattr

from harvester.base.temporary import TemporaryFolder
from harvester.base.writing import in_folder, whole_file
from harvester.device.piezo import PiezoTable
from harvester.interop.block import folder_of
from harvester.interop.compiling import LIBRARY, NO_COMPILER, compile_library, compiler
from harvester.interop.device_code import device_files, source
from harvester.scene.paths import start_state
from harvester.scene.prepared import Prepared
from harvester.version import __version__

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Default time between two exchanges with the simulating tool (s).
EXCHANGE = 1e-3
VERSIONS = (2, 3)
# Exponents of the SI base units in each unit.
UNITS = {
    "s": {"s": 1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "A": {"A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
}


class Variable(NamedTuple):
    """One variable of the model description; `start` is None for a computed variable."""

    name: str
    causality: str
    unit: str
    description: str
    start: float | None = None


def variables(setup: Prepared) -> list[Variable]:
    """All variables, in the order of `sources/fmi.h`."""
    scene = setup.scene
    x, v, state = start_state(setup, 0)
    length = setup.setting.length
    state *= scene.transducer.state_unit(setup.setting)
    drawn = Variable("current", "input", "A", "Drawn out of the positive terminal", 0.0)
    across = Variable("voltage", "input", "V", "Across the terminals", 0.0)
    if isinstance(scene.transducer, PiezoTable):
        terminal, resistor, unit, kind = drawn, "across the terminals", "V", "voltage"
        output = Variable("voltage", "output", "V", "Across the terminals")
    else:
        terminal, resistor, unit, kind = across, "in series", "A", "current"
        output = Variable("current", "output", "A", "Out of the positive terminal")
    base = "Acceleration of the base; the force on the mass is opposite"
    return [
        Variable("time", "independent", "s", "Time"),
        Variable("base_acceleration", "input", "m/s2", base, 0.0),
        terminal,
        Variable("load_resistance", "parameter", "Ohm", f"Resistor {resistor}; 0: none", 0.0),
        Variable("start_displacement", "parameter", "m", "At the beginning", x * length),
        Variable("start_velocity", "parameter", "m/s", "At the beginning", v * length),
        Variable(f"start_{kind}", "parameter", unit, "At the beginning", state),
        output,
        Variable("displacement", "output", "m", "Of the mass, against the base"),
        Variable("velocity", "output", "m/s", "Of the mass, against the base"),
        Variable("energy_input", "output", "J", "Put in by the base since the beginning"),
        Variable("energy_stored", "output", "J", "Gained by mass, spring, contacts and transducer"),
        Variable("energy_damper", "output", "J", "Lost in the damper"),
        Variable("energy_contacts", "output", "J", "Lost in contacts"),
        Variable("energy_transducer", "output", "J", "Lost in the transducer itself"),
        Variable("energy_delivered", "output", "J", "Delivered, including the resistor"),
    ]


def unit_files(setup: Prepared, version: int) -> tuple[str, dict[str, str]]:
    """The instantiation token and the texts of an FMU's sources by file names."""
    files = device_files(setup)
    files |= {name: source(name) for name in ("fmi.h", f"fmi{version}.c")}
    digest = hashlib.sha256("".join(files.values()).encode()).hexdigest()
    token = "{" + re.sub(r"^(.{8})(.{4})(.{4})(.{4})(.{12}).*", r"\1-\2-\3-\4-\5", digest) + "}"
    files["token.h"] = f'#define TOKEN "{token}"\n'
    return token, files


def write_fmu(setup: Prepared, output: str | Path, *, report: Callable[[str], None]) -> list[Path]:
    """Write a scene's device as FMUs for FMI 2.0 and 3.0: SCENE.fmi2.fmu and SCENE.fmi3.fmu.

    The FMUs contain sources, and binaries for this machine if there is a C compiler.

    Parameters
    ----------
    output : str or Path
        Folder.
    report : callable
        Called with a note if there is no compiler.

    Raises
    ------
    ExportError
        See `harvester.interop.device_code.equations`.
    """
    contents = [_fmu(setup, version) for version in VERSIONS]
    folder = folder_of(output, "fmu")
    paths = [in_folder(folder, f"{setup.scene.name}.fmi{version}.fmu") for version in VERSIONS]
    for path, content in zip(paths, contents, strict=True):
        with whole_file(path) as file:
            file.write(content)
    if compiler() is None:
        report(f"{NO_COMPILER}; the FMUs contain only sources: `fmpy compile` adds binaries")
    return paths


def _fmu(setup: Prepared, version: int) -> bytes:
    """The zipped content of one FMU."""
    # The scene's name as a C identifier.
    name = re.sub(r"^(?=\d)", "_", re.sub(r"[^A-Za-z0-9_]", "_", setup.scene.name))
    token, files = unit_files(setup, version)
    content = {f"sources/{file}": text.encode() for file, text in files.items()}
    describe = _description2 if version == 2 else _description3
    compiled = sorted(file for file in files if file.endswith(".c"))
    content["modelDescription.xml"] = describe(setup, name, token, compiled).encode()
    if version == 3:
        content["sources/buildDescription.xml"] = _build_description(name, compiled).encode()
    if compiler() is not None:
        with TemporaryFolder() as folder:
            library = Path(folder) / f"{name}{LIBRARY}"
            compile_library(files, library)
            content[f"binaries/{platform_folder(version)}/{library.name}"] = library.read_bytes()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in content.items():
            # No time stamps, so that the same scene gives identical bytes.
            archive.writestr(zipfile.ZipInfo(path), data, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def platform_folder(version: int) -> str:
    """Name of this machine's folder below `binaries/`."""
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    machine = platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64", "i686": "x86"}.get(machine, machine)
    if version == 3:
        return f"{machine}-{system}"
    bits = "64" if sys.maxsize > 2**32 else "32"
    return ("win" if system == "windows" else system) + bits


def _attributes(**values: object) -> str:
    """Attributes of an XML element; values that are None are omitted."""
    return "".join(
        f" {key}={quoteattr(repr(value) if isinstance(value, float) else str(value))}"
        for key, value in values.items()
        if value is not None
    )


def _definitions(scene: Scene) -> str:
    """Units, default experiment, and the beginning of the variables."""
    units = "".join(
        f"    <Unit name={quoteattr(name)}><BaseUnit{_attributes(**exponents)}/></Unit>\n"
        for name, exponents in UNITS.items()
    )
    stop = float(scene.run.duration)
    experiment = _attributes(startTime=0.0, stopTime=stop, stepSize=EXCHANGE)
    return (
        f"  <UnitDefinitions>\n{units}  </UnitDefinitions>\n  <DefaultExperiment{experiment}/>\n"
        "  <ModelVariables>\n"
    )


def _head(scene: Scene, version: str, token: str) -> str:
    key = "guid" if version == "2.0" else "instantiationToken"
    return '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription' + _attributes(
        fmiVersion=version, modelName=scene.name, **{key: token},
        description=f"Vibration energy harvester, scene {scene.name}",
        generationTool=f"harvester {__version__}", variableNamingConvention="structured",
    )  # fmt: skip


def _kinds(variable: Variable) -> dict[str, str | None]:
    """The FMI attributes `variability` and `initial` of a variable."""
    variability = "fixed" if variable.causality == "parameter" else "continuous"
    initial = {"parameter": "exact", "output": "calculated"}.get(variable.causality)
    return {"variability": variability, "initial": initial}


def _description2(setup: Prepared, name: str, token: str, compiled: list[str]) -> str:
    """modelDescription.xml of FMI 2.0."""
    scene = setup.scene
    listed = variables(setup)
    # In FMI 2.0 time is implicit, and variables are numbered from 1.
    text = _head(scene, "2.0", token) + ">\n"
    ability = _attributes(
        modelIdentifier=name, canHandleVariableCommunicationStepSize="true",
        canInterpolateInputs="true",
    )  # fmt: skip
    text += f"  <CoSimulation{ability}>\n    <SourceFiles>\n"
    text += "".join(f"      <File{_attributes(name=file)}/>\n" for file in compiled)
    text += f"    </SourceFiles>\n  </CoSimulation>\n{_definitions(scene)}"
    for reference, variable in enumerate(listed):
        attributes = _attributes(
            name=variable.name, valueReference=reference, description=variable.description,
            causality=variable.causality, **_kinds(variable),
        )  # fmt: skip
        real = _attributes(unit=variable.unit, start=variable.start)
        text += f"    <ScalarVariable{attributes}><Real{real}/></ScalarVariable>\n"
    outputs = [k for k, variable in enumerate(listed, start=1) if variable.causality == "output"]
    unknowns = "".join(f"      <Unknown{_attributes(index=k)}/>\n" for k in outputs)
    return (
        f"{text}  </ModelVariables>\n  <ModelStructure>\n    <Outputs>\n{unknowns}    </Outputs>\n"
        f"    <InitialUnknowns>\n{unknowns}    </InitialUnknowns>\n  </ModelStructure>\n"
        "</fmiModelDescription>\n"
    )


def _description3(setup: Prepared, name: str, token: str, compiled: list[str]) -> str:
    """modelDescription.xml of FMI 3.0."""
    scene = setup.scene
    listed = variables(setup)
    ability = _attributes(modelIdentifier=name, canHandleVariableCommunicationStepSize="true")
    text = f"{_head(scene, '3.0', token)}>\n  <CoSimulation{ability}/>\n{_definitions(scene)}"
    for reference, variable in enumerate(listed):
        attributes = _attributes(
            name=variable.name, valueReference=reference, description=variable.description,
            causality=variable.causality, unit=variable.unit, start=variable.start,
            **_kinds(variable),
        )  # fmt: skip
        text += f"    <Float64{attributes}/>\n"
    outputs = [k for k, variable in enumerate(listed) if variable.causality == "output"]
    structure = "".join(f"    <Output{_attributes(valueReference=k)}/>\n" for k in outputs)
    structure += "".join(f"    <InitialUnknown{_attributes(valueReference=k)}/>\n" for k in outputs)
    return (
        f"{text}  </ModelVariables>\n  <ModelStructure>\n{structure}  </ModelStructure>\n"
        "</fmiModelDescription>\n"
    )


def _build_description(name: str, compiled: list[str]) -> str:
    """sources/buildDescription.xml of FMI 3.0."""
    files = "".join(f"      <SourceFile{_attributes(name=file)}/>\n" for file in compiled)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
        f"  <BuildConfiguration{_attributes(modelIdentifier=name)}>\n"
        f'    <SourceFileSet language="C99">\n{files}    </SourceFileSet>\n'
        "  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )
