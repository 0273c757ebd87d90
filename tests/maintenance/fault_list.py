"""Faults of one line that tests of `make test` must see: what `make faults` puts into copies.

An entry holds a text that stands once in its file and what replaces it. Where the source has been
rewritten the text is gone, and `tests/maintenance/test_faults.py` asks for another fault of the
same kind in its place: one that still compiles and gives plausible wrong numbers.
"""

from __future__ import annotations

from typing import NamedTuple


class Fault(NamedTuple):
    """A fault, and the tests that should see it.

    Attributes
    ----------
    title : what goes wrong.
    file : from the checkout's folder.
    before, after : parts of a line; the first stands once in the file.
    tests : files, folders or tests within `tests`, cheap ones.
    """

    title: str
    file: str
    before: str
    after: str
    tests: tuple[str, ...]


SPRING, DAMPER, CONTACT, HERTZ, PIEZO, COIL, SYSTEM = (
    f"harvester/device/{name}.py"
    for name in ("polynomial", "damper", "contact", "hertz", "piezo", "coil", "system")
)
FORCE_TABLE, UNITS = "harvester/device/force_table.py", "harvester/scene/units.py"
MOMENTS, SEVERAL, OUTPUT_SIDE, JUMPS = (
    f"harvester/statistics/{name}.py" for name in ("moments", "several", "output_moments", "jumps")
)
BATCH_MEANS, ESTIMATE, MEANS, BALANCE, MEASURES = (
    f"harvester/statistics/{name}.py"
    for name in ("batch_means", "estimate", "run_quantities", "balance", "measures")
)
PAIRED = "harvester/statistics/paired.py"
JUNCTION, SWITCHING, PARTS = (
    f"circuits/kernel/{name}.py" for name in ("junction", "switching", "parts")
)
PROPAGATOR = "harvester/averaging/propagator.py"
CLOSURES, ORBITS = "harvester/averaging/over_orbits.py", "harvester/averaging/orbits.py"
INTERVALS = "harvester/identification/intervals.py"
COMMAND_LINE = "harvester/cli/command_line.py"

OF_SYSTEM = "harvester/device/test_system.py"
ONE_DEFINITION = "harvester/device/test_one_definition.py"
ALL_FORMS = (f"{ONE_DEFINITION}::test_all_forms_of_a_device_agree_at_random_states",)
EQUATION_5 = (f"{OF_SYSTEM}::test_the_contact_force_is_that_of_eq_5_on_either_side",)
TRANSDUCERS = ("harvester/device/test_transducers.py",)
OF_MEANS, OF_MEASURES = (
    "harvester/statistics/test_run_quantities.py",
    "harvester/statistics/test_measures.py",
)
EXACT_ERROR = (f"{OF_MEANS}::test_in_the_mean_the_error_bar_is_exact",)
OF_SEVERAL = ("harvester/statistics/test_several.py",)
OF_JUNCTION, NUMBERS = ("circuits/kernel/test_junction.py",), ("circuits/netlist/test_numbers.py",)
TURNS = (
    "circuits/kernel/test_switching.py"
    "::test_a_switch_turns_beyond_its_hysteresis_and_when_its_control_passes_it",
)
OF_STORE = "harvester/engines/test_store.py"
OF_DENSITIES = ("harvester/statistics/test_densities.py",)
OF_ORBITS = "harvester/studies/orbits/test_orbits.py"
OF_SPECTRUM = "harvester/excitation/test_spectrum.py"
WELL_BALANCE = "harvester/statistics/well_balance.py"
OF_WELL_BALANCE = ("harvester/statistics/test_well_balance.py",)
OF_OPTIONS = ("harvester/cli/test_options.py",)
KEY = (f"{OF_STORE}::test_the_key_follows_all_that_decides_the_numbers",)
NO_ANSWER = (f"{OF_STORE}::test_what_is_no_answer_is_named_and_written_again",)
LINEAR = ("harvester/averaging/test_fokker_planck.py::test_linear_device",)
SMALL_DAMPING = ("harvester/averaging/test_closures.py::test_linear_device_at_small_damping",)
PRINTED = ("harvester/averaging/test_printed_closure.py",)
OF_INTERVALS = ("harvester/identification/test_intervals.py",)
MANNERS = (
    "harvester/test_command_line_manners.py::test_a_command_ends_with_the_code_that_is_told",
)

FAULTS = [
    Fault(
        "spring: an even power's energy is divided by another number",
        SPRING,
        "tuple(k / (2 * m + 1) for m, k in enumerate(even))",
        "tuple(k / (m + 1) for m, k in enumerate(even))",
        (f"{OF_SYSTEM}::test_a_spring_is_its_polynomial_and_its_energy_the_integral",),
    ),
    Fault(
        "spring: the bound of the stiffness is too low",
        SPRING,
        "odd_slope=tuple((2 * m + 1) * abs(k) for",
        "odd_slope=tuple((m + 1) * abs(k) for",
        (f"{OF_SYSTEM}::test_a_spring_is_its_polynomial_and_its_energy_the_integral",),
    ),
    Fault(
        "spring: the gain formula has another sign at the gap",
        SPRING,
        "constant = linear / rate**2 + half * gap**2",
        "constant = linear / rate**2 - half * gap**2",
        ALL_FORMS,
    ),
    Fault(
        "table: the energy of a bend is divided by another number",
        FORCE_TABLE,
        "energy_cubes=tuple(s * a / 3.0 for",
        "energy_cubes=tuple(s * a / 2.0 for",
        ("harvester/device/test_springs.py::test_a_table_is_scipys_and_its_energy_the_integral",),
    ),
    Fault(
        "strain: what the modes left out do under a voltage has another sign",
        "harvester/device/beam/strain.py",
        "per_volt=-(height - cut.axis) * by_volt",
        "per_volt=(height - cut.axis) * by_volt",
        ("harvester/device/beam/test_strain.py::test_static_deflection_of_a_uniform_beam",),
    ),
    Fault(
        "strain: a peak is that of the record's points",
        "harvester/statistics/strain_moments.py",
        "return middle[k] - 0.25 * slope * slope / bend",
        "return middle[k]",
        ("harvester/device/beam/test_strain.py::test_cycles_of_e1049",),
    ),
    Fault(
        "base: its factor divides what drives the mass",
        UNITS,
        "return length / scene.oscillator.base_factor",
        "return length * scene.oscillator.base_factor",
        ("harvester/scene/test_base_factor.py::test_it_counts_as_a_base_that_moves_as_much_more",),
    ),
    Fault(
        "damper: drag pushes a mass that moves to the left",
        DAMPER,
        "return (self.damping + self.quadratic_damping * np.abs(v)) * v",
        "return (self.damping + self.quadratic_damping * v) * v",
        (f"{ONE_DEFINITION}::test_a_drag_takes_energy_whichever_way_the_mass_moves",),
    ),
    Fault(
        "contact: the damping has another power of the depth",
        HERTZ,
        "return factor * depth * power_below(self, depth) / np.maximum(",
        "return factor * depth * depth / np.maximum(",
        EQUATION_5,
    ),
    Fault(
        "contact: the restitution is not squared",
        HERTZ,
        "0.75 * (1.0 - restitution * restitution)",
        "0.75 * (1.0 - restitution)",
        ALL_FORMS,
    ),
    Fault(
        "contact: the left stopper takes the spring's energy at the right one",
        CONTACT,
        "springs.energy(spring, s * contact.gap)",
        "springs.energy(spring, contact.gap)",
        ALL_FORMS,
    ),
    Fault(
        "contact: the netlist's impact speed lacks half the contact's energy",
        HERTZ,
        "twice = 2.0 / order * self.stiffness",
        "twice = 1.0 / order * self.stiffness",
        ALL_FORMS,
    ),
    Fault(
        "contact: a step forgets the energy that the contact holds",
        CONTACT,
        "square = square_speed + 2.0 * elastic_energy",
        "square = square_speed + 0.0 * elastic_energy",
        (f"{OF_SYSTEM}::test_the_contact_step_is_that_of_the_speed_at_which_the_contact_began",),
    ),
    Fault(
        "piezo: the loss is the load's",
        PIEZO,
        "return self.coupling * self.own_rate * state * state",
        "return self.coupling * self.load_rate * state * state",
        TRANSDUCERS,
    ),
    Fault(
        "piezo: the leak is left out",
        PIEZO,
        "leak = 1.0 / (self.leakage_resistance * cp) if",
        "leak = 0.0 / (self.leakage_resistance * cp) if",
        TRANSDUCERS,
    ),
    Fault(
        "coil: winding and load exchange their shares",
        COIL,
        "else resistance / (resistance + load_resistance)",
        "else load_resistance / (resistance + load_resistance)",
        TRANSDUCERS,
    ),
    Fault(
        "coil: the load's power is the winding's",
        COIL,
        "share = self.current_share * (1.0 - self.current_share)",
        "share = self.current_share * self.current_share",
        TRANSDUCERS,
    ),
    Fault(
        "noise: a knot decays by half as much",
        "harvester/excitation/correlated_normals.py",
        "math.sqrt(-math.expm1(-2.0 * decay))",
        "math.sqrt(-math.expm1(-1.0 * decay))",
        ("harvester/excitation/test_correlated_normals.py",),
    ),
    Fault(
        "noise: white noise has half its intensity",
        "harvester/excitation/white.py",
        "math.sqrt(2.0 * (self.intensity / length**2) / spacing)",
        "math.sqrt((self.intensity / length**2) / spacing)",
        ("harvester/excitation/test_kinds.py::test_white_noise_has_its_density_at_low_frequency",),
    ),
    Fault(
        "noise: all realizations have the first one's",
        "harvester/excitation/base.py",
        "spawn_key=(index,)",
        "spawn_key=(0,)",
        ("harvester/excitation/test_ornstein_uhlenbeck.py",),
    ),
    Fault(
        "steps: a stage of Runge-Kutta goes from the first slope",
        "harvester/device/schemes.py",
        "held, x + half * v2, v3, e3, middle)",
        "held, x + half * v, v3, e3, middle)",
        (
            "harvester/engines/monte_carlo/test_engine.py"
            "::test_the_order_is_four_against_scipy_on_the_same_path",
        ),
    ),
    Fault(
        "steps: finer ones are not finer in a contact",
        "harvester/scene/steps.py",
        "return math.ceil(fewest * max(finer, 1.0))",
        "return math.ceil(fewest)",
        ("harvester/scene/test_steps.py",),
    ),
    Fault(
        "steps: the cubic to an edge bends at the other end",
        "harvester/device/zones.py",
        "bend = u * w * (a * w + b * u)",
        "bend = u * w * (a * u + b * w)",
        ("harvester/device/test_zones.py",),
    ),
    Fault(
        "moments: the last point of a stretch counts twice",
        MOMENTS,
        "weights[-1] = 0.5 * (time[end] - time[end - 1])",
        "weights[-1] = time[end] - time[end - 1]",
        (f"{OF_MEANS}::test_moments_are_the_integrals_of_the_record",),
    ),
    Fault(
        "moments: a product is that of other powers",
        MOMENTS,
        "p7 += weight * load * loss",
        "p7 += weight * load * load",
        (f"{OF_MEANS}::test_effective_samples_are_the_points_where_each_is_drawn_anew",),
    ),
    Fault(
        "moments: a product has its factors from two times",
        SEVERAL,
        "half * (loads[0] * losses[0] + loads[1] * losses[1])",
        "half * (loads[0] * losses[1] + loads[1] * losses[0])",
        OF_SEVERAL,
    ),
    Fault(
        "moments: a mass that stays in a contact makes impacts",
        SEVERAL,
        "& (low <= before) & (before <= high) & measured",
        "& (low <= before) & measured",
        OF_SEVERAL,
    ),
    Fault(
        "moments: a jump counts as one the other way",
        JUMPS,
        "counts[batch, well, nearest] += 1.0",
        "counts[batch, nearest, well] += 1.0",
        ("harvester/statistics/test_jumps.py",),
    ),
    Fault(
        "moments: the load's stores are emptied where they are filled",
        OUTPUT_SIDE,
        "held += factor * one * other",
        "held -= factor * one * other",
        ("harvester/statistics/test_output_moments.py", "circuits/netlist/test_supplies.py"),
    ),
    Fault(
        "batch means: a batch is joined with itself",
        BATCH_MEANS,
        "series[:, odd::2] + series[:, odd + 1 :: 2]",
        "series[:, odd::2] + series[:, odd::2]",
        EXACT_ERROR,
    ),
    Fault(
        "batch means: one that was not completed counts",
        BATCH_MEANS,
        "m.batch_length + 1e-6)",
        "m.batch_length + 1)",
        (f"{OF_MEANS}::test_a_batch_that_was_not_completed_is_left_out",),
    ),
    Fault(
        "error bars: neighbours are taken for independent",
        BATCH_MEANS,
        "_raised(variance, series.size / max(factor, 1.0))",
        "_raised(variance, series.size)",
        EXACT_ERROR,
    ),
    Fault(
        "error bars: every mean has the correlation time of mean squares",
        BATCH_MEANS,
        "return min(max((neighbours + 2.0 * chance) / (expected or 1.0), 0.0), 1.0)",
        "return 1.0",
        (f"{OF_MEANS}::test_uncorrelated_batches_and_those_that_take_back_have_no_wider_error",),
    ),
    Fault(
        "error bars: neighbours of a drifting record are less correlated",
        BATCH_MEANS,
        "(1.0 + 2.0 * successive) / (2.0 + 2.0 * successive)",
        "(1.0 + 2.0 * successive) / 2.0",
        EXACT_ERROR,
    ),
    Fault(
        "error bars: a ratio's denominator is taken for certain",
        BATCH_MEANS,
        "(upper - upper.sum() / lower.sum() * lower) / lower.mean()",
        "upper / lower.mean()",
        (f"{OF_MEANS}::test_a_ratio_that_never_varies_has_no_error",),
    ),
    Fault(
        "error bars: one stays in other units",
        ESTIMATE,
        "standard_error=None if error is None else error * abs(factor)",
        "standard_error=None if error is None else error",
        (f"{OF_MEANS}::test_an_error_bar_has_the_unit_of_its_estimate",),
    ),
    Fault(
        "error bars: common noise adds up in a difference of efficiencies",
        PAIRED,
        "error(shares[0] - shares[1])",
        "error(shares[0] + shares[1])",
        (f"{OF_MEANS}::test_what_two_results_have_in_common_cancels_from_their_difference",),
    ),
    Fault(
        "error bars: few events scatter as their number",
        MEASURES,
        "math.sqrt(max(count, 1.0))",
        "max(count, 1.0)",
        (f"{OF_MEASURES}::test_few_events_are_known_no_better_than_independent_ones",),
    ),
    Fault(
        "error bars: an efficiency's powers are less correlated",
        MEANS,
        "(upper_square - 2.0 * ratio * cross + ratio**2",
        "(upper_square - ratio * cross + ratio**2",
        (f"{OF_MEANS}::test_effective_samples_are_the_points_where_each_is_drawn_anew",),
    ),
    Fault(
        "energy balance: what is stored in the end is not found again",
        BALANCE,
        "(put_in - out - stored) / scale",
        "(put_in - out) / scale",
        (f"{OF_MEANS}::test_the_residual_sees_a_wrong_coefficient",),
    ),
    Fault(
        "energy balance: motion holds twice its energy",
        SYSTEM,
        "mechanical = 0.5 * v * v + potential(s, x)",
        "mechanical = v * v + potential(s, x)",
        (f"{OF_SYSTEM}::test_what_flows_in_is_stored_or_lost",),
    ),
    Fault(
        "reader: the Greek letter is a thousandth of a millionth",
        "circuits/netlist/reader.py",
        '.replace("µ", "u")',
        '.replace("µ", "n")',
        ("circuits/netlist/test_subcircuits.py",),
    ),
    Fault(
        "reader: u is a thousandth",
        "circuits/netlist/numbers.py",
        '"u": -6',
        '"u": -3',
        NUMBERS,
    ),
    Fault(
        "reader: meg is a thousandth",
        "circuits/netlist/numbers.py",
        '"meg": 6',
        '"meg": -3',
        NUMBERS,
    ),
    Fault(
        "diode: the emission coefficient is 1",
        JUNCTION,
        'swing = model["n"] * volts',
        "swing = 1.0 * volts",
        OF_JUNCTION,
    ),
    Fault(
        "diode: breakdown has no emission coefficient",
        JUNCTION,
        'model.get("nbv", model["n"])',
        'model.get("nbv", 1.0)',
        OF_JUNCTION,
    ),
    Fault(
        "diode: several have one's series resistance",
        JUNCTION,
        'model["rs"] / all_of_them',
        'model["rs"] / area',
        OF_JUNCTION,
    ),
    Fault(
        "switch: half the hysteresis is missing",
        "circuits/netlist/part_models.py",
        "return middle - half, middle + half",
        "return middle - half, middle",
        ("circuits/test_load_watch.py",),
    ),
    Fault(
        "switch: it turns where it is as far from the step's end",
        SWITCHING,
        "share = (limit - before) / (after - before) if",
        "share = (after - limit) / (after - before) if",
        TURNS,
    ),
    Fault(
        "measures: shares are of the load's power",
        MEASURES,
        'put_in = batches[:, :, QUANTITIES.index("input_power")]',
        'put_in = batches[:, :, QUANTITIES.index("load_power")]',
        (f"{OF_MEASURES}::test_powers_shares_and_events",),
    ),
    Fault(
        "measures: half of what is stored is harvested",
        "harvester/statistics/output_side.py",
        "harvested = consumed - delivered + stored",
        "harvested = consumed - delivered + 0.5 * stored",
        ("harvester/statistics/test_output_moments.py", "circuits/netlist/test_supplies.py"),
    ),
    Fault(
        "store: the key does not tell seeds apart",
        "harvester/scene/model.py",
        'self._tables("file")',
        'self._tables("file", "seed")',
        KEY,
    ),
    Fault(
        "store: the key does not tell steps apart",
        "harvester/engines/task.py",
        "_plain(self.arguments),",
        '_plain({**self.arguments, "step": ""}),',
        KEY,
    ),
    Fault(
        "store: the key does not tell engines' versions apart",
        "harvester/engines/task.py",
        'f"harvester {__version__}, {self.version}"',
        'f"harvester {__version__}"',
        KEY,
    ),
    Fault(
        "kill and resume: a damaged answer is believed",
        "harvester/engines/codec.py",
        "if digest != digest_of(arrays):",
        "if not digest:",
        NO_ANSWER,
    ),
    Fault(
        "kill and resume: another task's answer is believed",
        "harvester/engines/codec.py",
        'if tree["key"] != key:',
        'if not tree["key"]:',
        (f"{OF_STORE}::test_an_answer_under_another_name_is_none",),
    ),
    Fault(
        "kill and resume: what ended by a limit is kept as an answer",
        "harvester/engines/store.py",
        "final = not is_error or",
        "final = True or",
        (f"{OF_STORE}::test_what_another_run_may_end_otherwise_is_not_kept",),
    ),
    Fault(
        "error bars: an exponent's is a quarter",
        "harvester/statistics/attractors.py",
        "return Divergence(float(exponent), float(error))",
        "return Divergence(float(exponent), float(error) / 4.0)",
        (f"{OF_ORBITS}::test_the_error_of_an_exponent_is_how_far_it_lies_off",),
    ),
    Fault(
        "error bars: that of the largest strain falls with the number of realizations",
        "harvester/statistics/strain.py",
        "float(highest.std(ddof=1)) / math.sqrt(count) * wider",
        "float(highest.std(ddof=1)) / count * wider",
        ("harvester/device/beam/test_strain.py::test_peaks_have_the_errors_of_their_realizations",),
    ),
    Fault(
        "error bars: that of a density of several wells falls with the number of groups",
        WELL_BALANCE,
        "return parts.std(axis=0, ddof=1) / math.sqrt(count - len(slopes))",
        "return parts.std(axis=0, ddof=1) / (count - len(slopes))",
        OF_WELL_BALANCE,
    ),
    Fault(
        "error bars: that within the wells falls with the number of groups",
        WELL_BALANCE,
        "within_errors = within.std(axis=0, ddof=1) / math.sqrt(count)",
        "within_errors = within.std(axis=0, ddof=1) / count",
        OF_WELL_BALANCE,
    ),
    Fault(
        "error bars: that of a share falls with the number of starts",
        "harvester/results/orbit.py",
        "return math.sqrt(share * (1.0 - share) / count)",
        "return math.sqrt(share * (1.0 - share)) / count",
        ("harvester/studies/orbits/test_errors.py",),
    ),
    Fault(
        "error bars: a residence time's is half of its stays'",
        "harvester/studies/orbits/residence.py",
        "float((off**2).sum())) / count",
        "float((off**2).sum())) / (2.0 * count)",
        ("harvester/studies/orbits/test_errors.py",),
    ),
    Fault(
        "error bars: a density's falls with the number of groups",
        "harvester/statistics/densities.py",
        "deviations.std(axis=0, ddof=1) / math.sqrt(len(groups))",
        "deviations.std(axis=0, ddof=1) / len(groups)",
        OF_DENSITIES,
    ),
    Fault(
        "error bars: a joint density's falls with the number of groups",
        "harvester/statistics/joint_density.py",
        "densities.std(axis=0, ddof=1) / math.sqrt(len(counts))",
        "densities.std(axis=0, ddof=1) / len(counts)",
        OF_DENSITIES,
    ),
    Fault(
        "spectrum: a kurtosis has the scatter of means that leave one out",
        "harvester/studies/spectrum.py",
        "np.std(parts) * math.sqrt(count - 1)",
        "np.std(parts)",
        ("harvester/studies/test_spectrum.py::test_errors_and_p_values_of_gaussian_noise_hold",),
    ),
    Fault(
        "noise: a swept sine is raised by half of what straight lines take",
        "harvester/excitation/swept_sine.py",
        "np.sinc(frequency * self.spacing) ** 2",
        "np.sinc(frequency * self.spacing)",
        ("harvester/excitation/test_swept_sine.py",),
    ),
    Fault(
        "noise: a spectrum is raised by half of what straight lines take",
        "harvester/excitation/shaped.py",
        "/ np.sinc(frequencies * spacing) ** 2",
        "/ np.sinc(frequencies * spacing)",
        (f"{OF_SPECTRUM}::test_a_flat_density_is_flat_between_knots_that_are_far_apart",),
    ),
    Fault(
        "stationary solver: the noise forgets nothing within a step",
        PROPAGATOR,
        "np.exp(-(push**2) * (passed - forgotten))",
        "np.exp(-(push**2) * passed)",
        ("harvester/averaging/test_propagator.py::test_steps_of_a_free_mass",),
    ),
    Fault(
        "stationary solver: a charge decays by a step of Euler",
        PROPAGATOR,
        "(grid.z - grid.x[:, None]) * np.exp(-rate * time)",
        "(grid.z - grid.x[:, None]) * (1.0 - rate * time)",
        LINEAR,
    ),
    Fault(
        "stationary solver: a fiftieth of the power put in is lost",
        "harvester/averaging/solution.py",
        "np.sum(gained * v**2)) * 0.5 / grid.step",
        "np.sum(gained * v**2)) * 0.49 / grid.step",
        LINEAR,
    ),
    Fault(
        "closures: `consistent` takes the charge about the middle",
        ORBITS,
        "Edge(system, inside=True, anchor=timescales.rest(system)), np.inf",
        "Edge(system, inside=True), np.inf",
        ("harvester/averaging/test_closures.py::test_in_well_simulation",),
    ),
    Fault(
        "closures: the noise has no colour in the exponent",
        ORBITS,
        "rate = loss / (system.noise.intensity * self.spectrum)",
        "rate = loss / system.noise.intensity",
        SMALL_DAMPING,
    ),
    Fault(
        "closures: the spectrum of `paper` multiplies where it divides",
        CLOSURES,
        "ln - np.log(power) for ln",
        "ln + np.log(power) for ln",
        PRINTED,
    ),
    Fault(
        "identification: an interval is one standard error wide on either side",
        "harvester/identification/validation_record.py",
        "HALF_INTERVAL = 1.96",
        "HALF_INTERVAL = 1.0",
        OF_INTERVALS,
    ),
    Fault(
        "identification: half of the residuals' spectrum counts",
        INTERVALS,
        "weight = np.full(frequencies.size, 2.0 / samples)",
        "weight = np.full(frequencies.size, 1.0 / samples)",
        OF_INTERVALS,
    ),
    Fault(
        "identification: windows absorb nothing of the drawn noise",
        INTERVALS,
        "drawn = without_states(drawn.reshape(samples, outputs, -1), states, cuts)",
        "drawn = drawn.reshape(samples, outputs, -1)",
        OF_INTERVALS,
    ),
    Fault(
        "identification: starts of windows are taken for known",
        "harvester/identification/sensors.py",
        "(block - explained)",
        "(block - 0.0 * explained)",
        OF_INTERVALS,
    ),
    Fault(
        "identification: a rival that leaves more than noise is proposed",
        "harvester/identification/verdict.py",
        "if model.is_better and model.explains]",
        "if model.is_better]",
        ("harvester/identification/test_verdict.py",),
    ),
    Fault(
        "identification: one explained record excuses the others",
        "harvester/identification/verdict.py",
        "not record.is_explained, record.worst.beyond",
        "record.is_explained, record.worst.beyond",
        ("harvester/identification/test_verdict.py",),
    ),
    Fault(
        "command line: what a command ends with is lost",
        COMMAND_LINE,
        "return function(**values) or 0",
        "return 0 * (function(**values) or 0)",
        MANNERS,
    ),
    Fault(
        "command line: all words behind --record belong to the first of them",
        "harvester/cli/options.py",
        "if token.index == 0 or not kind.words:",
        "if not groups or not kind.words:",
        OF_OPTIONS,
    ),
    Fault(
        "command line: an option that turns a setting off turns it on",
        "harvester/cli/command.py",
        "values[name] ^= option.default is True",
        "values[name] ^= False",
        OF_OPTIONS,
    ),
    Fault(
        "command line: the first of two values of a key counts",
        "harvester/scene/source.py",
        "dict(map(parsed, texts(overrides)))",
        "dict(map(parsed, texts(overrides)[::-1]))",
        ("harvester/scene/test_overrides.py",),
    ),
    Fault(
        "frequency response: an amplitude is the highest displacement",
        "harvester/studies/frequency_response.py",
        "0.5 * (_peak(times, x[inside]) + _peak(times, -x[inside]))",
        "_peak(times, x[inside])",
        (
            "harvester/studies/test_frequency_response.py"
            "::test_an_amplitude_is_half_of_what_lies_between_the_ends",
        ),
    ),
    Fault(
        "sensitivity: a first-order index takes the other device",
        "harvester/studies/sensitivity/sobol.py",
        "first = np.array([product(b, c - a) for c in exchanged])",
        "first = np.array([product(a, c - b) for c in exchanged])",
        ("harvester/studies/test_sobol.py::test_the_estimators_are_those_of_salib",),
    ),
]
