"""`average`: a stationary method's result for a scene, in the form of an engine's result."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from harvester.averaging.method import DEFAULT_CLOSURE, Stationary
from harvester.base.errors import AveragingError, HarvesterError
from harvester.base.method import Method
from harvester.base.signatures import MethodOrName, Share
from harvester.scene.calling import takes_scene

if TYPE_CHECKING:
    from harvester.averaging.averages import Averages
    from harvester.device.system import System
    from harvester.results.result import Result
    from harvester.scene.model import Scene
    from harvester.scene.prepared import Prepared
    from harvester.statistics.estimate import Estimate

DIMENSIONS = {
    "mean_square_voltage": "voltage^2",
    "mean_power": "power",
    "power_conversion_efficiency": "1",
    "mean_square_displacement": "displacement^2",
    "mean_square_velocity": "velocity^2",
    "share_in_wells": "1",
    "mean_transducer_loss": "power",
}

# Quantities of several wells whose name begins so are shares; all others are rates.
SHARE = "share_of_time"


@takes_scene
def average(
    scene: Scene,
    *,
    method: MethodOrName = DEFAULT_CLOSURE,
    tolerance: Share | None = None,
    fit: bool = False,
    jump_rates: bool = False,
) -> Result:
    """Quantities and densities of a scene without simulation, by a stationary method.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one.
    method : str or Stationary
        fokker_planck (stationary density without averaging), paper (Eqs. 10–37 as printed,
        misprints corrected), consistent (with the constant force of the piezo in the potential) or
        spectral (linear device, exact from the spectrum of its excitation). In Python also
        `Stationary(…)`, an object that holds the settings below.
    tolerance : float or None
        Largest accepted relative numerical error (default: 1e-2; paper, consistent 1e-3, spectral
        1e-6).
    fit : bool
        For a recorded excitation: use Ornstein–Uhlenbeck noise with D and τ1 fitted to its
        spectrum, and note the deviation.
    jump_rates : bool
        For several wells, by fokker_planck: also compute the rates of jumps between them and the
        slowest decay rate, which takes two or three times as long.

    Returns
    -------
    Result
        `standard_error` holds the numerical error, estimated from a coarser grid.

    Raises
    ------
    AveragingError
        Unknown stationary method, or one that is not valid for these parameters.
    LoadError
        The load is no resistor.

    Examples
    --------
    ::

        harvester average paper --method consistent
    """
    from harvester.device import timescales
    from harvester.device.beam.magnets import magnet_notes
    from harvester.results.result import Result
    from harvester.scene.prepared import prepared
    from harvester.scene.units import require_resistor
    from harvester.statistics.estimate import Density
    from harvester.statistics.joint_density import JointDensity

    if isinstance(method, Method):
        options = {"tolerance": tolerance, "fit": fit, "jump_rates": jump_rates}
        if not isinstance(method, Stationary):
            raise HarvesterError(
                f"average: {method} is an engine: call simulate, or give Stationary(…)"
            )
        chosen = method.check_options_agree(options, {"fit": False, "jump_rates": False})
        method, tolerance = chosen.closure, chosen.tolerance
        fit, jump_rates = chosen.fit, chosen.jump_rates
    require_resistor(scene, "stochastic averaging")
    clock, processor = time.perf_counter(), time.process_time()
    spectrum_fit, noise = None, prepared(scene)
    if fit:
        spectrum_fit, noise = _fitted(noise)
    averages = averages_of(noise, method, tolerance, memory=jump_rates)
    parameters, scales = noise.system, noise.scales
    quantities = estimates_of(averages)
    if not timescales.bistable(parameters):
        quantities.pop("share_in_wells", None)
    if not parameters.lossy_transducer:
        quantities.pop("mean_transducer_loss", None)
    densities = {
        name: Density(*averages.density.tabulated(name), None, name)  # type: ignore[call-arg]
        for name in averages.density.names
    }
    joint = None
    if hasattr(averages.density, "tabulated_joint"):
        displacement, velocity, values = averages.density.tabulated_joint()
        joint = JointDensity(displacement, velocity, values, standard_error=None)
    return Result(
        scene=scene,
        engine=f"averaging {method}" + (" of fitted noise" if fit else ""),
        scaled_quantities=quantities,
        scales=scales,
        error_kind="numerical",
        energy_balance_residual=None,
        wall_seconds=time.perf_counter() - clock,
        engine_seconds=time.process_time() - processor,
        simulated_time=0.0,
        steps=0,
        step=None,
        realizations=0,
        engine_version=f"stochastic averaging, closure {method}",
        netlist_sha256=None,
        densities=densities,
        joint_density=joint,
        notes=(
            *(spectrum_fit.notes() if spectrum_fit else ()),
            *_left_out(parameters, method),
            *_on_validity(method, averages),
            *magnet_notes(scene.magnets),
        ),
        spectrum_fit=spectrum_fit,
    )


def _left_out(system, closure):
    """Notes on effects of the device that the stationary method leaves out."""
    from harvester.averaging.closures import CLOSURES

    share = system.transducer.base_rate(1.0)
    if not share or CLOSURES[closure].of_spectrum:
        return ()
    change = abs(share) * system.transducer.coupling
    return (
        f"{closure} leaves out the charge that the base moves (piezo.base_charge), which changes "
        f"the voltage near an open-circuit resonance by some {100.0 * change:.2g} %",
    )


def _on_validity(closure, averages):
    """Note on ± and on the weakest premise of a method that averages over orbits."""
    from harvester.averaging.closures import notes_on_errors

    if not averages.weakest_premise:
        return []
    premise = f"weakest premise: {averages.weakest_premise}, which averaging assumes to be ≪ 1"
    return [
        f"{note}; {premise}: compare with fokker_planck or simulate"
        for note in notes_on_errors([closure])
    ]


def averages_of(
    prepared_scene: Prepared, closure: str, tolerance: float | None = None, memory: bool = False
) -> Averages:
    """Scaled means of a scene by a method; see `harvester.averaging.closures.average`."""
    from harvester.averaging.closures import CLOSURES
    from harvester.averaging.closures import average as average_parameters
    from harvester.scene.units import require_resistor

    chosen = CLOSURES.get(closure)
    if memory and chosen is not None and not chosen.jump_rates:
        raise AveragingError(
            f"jump_rates: {closure} computes none; use the method fokker_planck, or simulate"
        )
    if chosen is None or not chosen.of_spectrum:
        return average_parameters(averaged_device(prepared_scene), closure, tolerance, memory)
    require_resistor(prepared_scene.scene, closure)
    _refuse_range(prepared_scene.scene)
    return chosen.average(prepared_scene, tolerance or chosen.tolerance)


def averaged_device(prepared_scene: Prepared) -> System:
    """A scene's device and noise in scaled form.

    Raises
    ------
    LoadError
        The load is no resistor.
    AveragingError
        The stationary method does not support the excitation.
    """
    from harvester.scene.units import require_resistor

    scene = prepared_scene.scene
    require_resistor(scene, "stochastic averaging")
    refusal = scene.excitation.averaging_refusal()
    if refusal:
        raise AveragingError(f'excitation.kind = "{scene.excitation.kind}": {refusal}')
    _refuse_range(scene)
    return prepared_scene.system


def _refuse_range(scene):
    """Raise if the spring has a range of validity: stationary densities are unbounded."""
    if scene.oscillator.restoring_force_range is not None:
        raise AveragingError(
            "oscillator.restoring_force_range: a stationary density extends beyond any range; use "
            "a spring without a range, or simulate"
        )


def estimates_of(averages: Averages) -> dict[str, Estimate]:
    """A stationary method's means as estimates with its numerical error."""
    from harvester.statistics.estimate import Estimate, root

    values = {name: getattr(averages, name) for name in DIMENSIONS} | averages.between_wells
    estimates = {
        name: Estimate(
            float(value),
            averages.numerical_error[name],
            None,
            DIMENSIONS.get(name) or ("1" if name.startswith(SHARE) else "rate"),
        )
        for name, value in values.items()
        if name in averages.numerical_error
    }
    return estimates | {"rms_voltage": root(estimates["mean_square_voltage"])}


def _fitted(recorded):
    """The fit to a prepared scene's record, and the prepared scene with the fitted noise."""
    from harvester.device import timescales
    from harvester.excitation.ornstein_uhlenbeck import OrnsteinUhlenbeck
    from harvester.excitation.recorded import RecordedMotion
    from harvester.excitation.spectrum_fit import fit_spectrum

    scene, scales = recorded.scene, recorded.scales
    if not isinstance(scene.excitation, RecordedMotion):
        raise AveragingError(
            f'excitation.kind = "{scene.excitation.kind}": --fit needs a recorded excitation'
        )
    resonance = timescales.angular_frequency(recorded.system) / (2.0 * math.pi)
    spectrum_fit = fit_spectrum(scene.excitation, resonance)
    noise = OrnsteinUhlenbeck(spectrum_fit.intensity, spectrum_fit.correlation_time)
    # Results keep the scene's unit of length.
    length = scales.displacement if scene.units == "SI" else None
    return spectrum_fit, recorded.replace(excitation=noise, length_scale=length)
