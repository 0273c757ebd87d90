"""Detect loads that deliver more energy than they take; notes on invalid efficiencies."""

from __future__ import annotations

import math
from typing import Any

from circuits.netlist.supplies import unbooked
from harvester.base.formatting import number, quantity
from harvester.statistics.estimate import Estimate

# Prefix of the names of powers from a load's sources.
SUPPLIED = "supplied_by_"
# If a load delivers more than it takes, by less than this share of its power, the step error may be
# the cause.
SMALL_EXCESS = 0.01
# Below this share the step error is the cause: a nearly lossless load has such an error of either
# sign.
STEPS_OWN_EXCESS = 5e-4
# If the output power is below this share of the input power, its step error may reach a few per
# cent, since steps are controlled by the transducer's energy. Among 300 random loads at `fine`, the
# engines differed by 1 to 12 % in four with shares of 1e-8 to 4e-6, and by less in all with shares
# above 6e-5.
FAINT_OUTPUT = 1e-5

# Stores feed an output if they deliver more than the first share of its power and more than one
# standard error. The error bar of a store that discharges once is too large, so the error is
# ignored above the second share.
DRAWN_SHARE, MOST_DRAWN = 0.01, 0.1
START_CHARGED = (
    "start the stores at their steady voltage (ic=VOLTS in the line of the capacitor; a library "
    "load has the parameter initial)"
)


def fed_by_stores(estimates: dict[str, Estimate]) -> str:
    """Text on the share of output power from the load's stores; empty if there is none.

    Capacitors whose value is an expression are not monitored. They are detected if an output takes
    more than the device delivers.
    """
    names = ("mean_power", "mean_output_power", "mean_storage_power")
    if not all(name in estimates for name in names):
        return ""
    load, output, stored = (estimates[name] for name in names)
    drawn, power = -stored.estimate, output.estimate
    if not power > 0.0:
        return ""
    if drawn > MOST_DRAWN * power or drawn > max(DRAWN_SHARE * power, stored.standard_error or 0.0):
        share, origin = min(drawn / power, 1.0), "the load's stores"
    elif power > (1.0 + DRAWN_SHARE) * load.estimate:
        share, origin = 1.0 - max(load.estimate, 0.0) / power, "within the load"
    else:
        return ""
    percent = number(100.0 * share, 2)
    return f"{percent} % of the output power comes from {origin}, not from the device"


def store_notes(estimates: dict[str, Estimate]) -> tuple[str, ...]:
    """A note if the load's stores feed an output."""
    fed = fed_by_stores(estimates)
    if not fed:
        return ()
    advice = f"the stores discharge during the measured time: raise run.settle, or {START_CHARGED}"
    if "within" in fed:
        advice = "check its sources, its values below 0 and capacitors with an expression as value"
    return (f"{fed}; {advice}",)


def efficiency_notes(
    estimates: dict[str, Estimate], power_scale: float, unit: str
) -> tuple[str, ...]:
    """Notes on a load that delivers energy, and on every efficiency outside 0 … 1.

    The energy of the output's resistors and storage comes through the piezo's terminals, unless the
    load has a source, a negative resistance, or energy stored at the start. `power_scale` is the
    value of a scaled power of 1 in `unit`.
    """
    outside = [
        name.replace("_", " ")
        for name, estimate in estimates.items()
        if "efficiency" in name
        and not 0.0 <= estimate.estimate <= 1.0
        # NaN: no power was put in.
        and estimate.estimate == estimate.estimate
    ]

    def value(name, missing=0.0):
        return estimates[name].estimate if name in estimates else missing

    absorbed = value("mean_power")
    lost = value("mean_converter_loss", absorbed)
    if lost < 0.0:
        share = -lost / abs(absorbed) if absorbed else math.inf
        if share <= STEPS_OWN_EXCESS:
            return (
                f"the load delivers {share:.1g} of its power more than it takes: this is the error "
                "of the steps, as the load is nearly lossless",
            )
        excess = f"{-lost * power_scale:.3g} {unit} more than it takes from the piezo"
        if share <= SMALL_EXCESS:
            return (
                f"the load is not passive, or the step too long: it delivers {excess}, {share:.1g} "
                "of its power; choose a shorter step",
            )
        return (
            f"the load is not passive: it delivers {excess} ({absorbed * power_scale:.3g} {unit}), "
            "from its sources or its initial charge; its efficiencies are not "
            "shares of the piezo's power",
        )
    if any(name.startswith(SUPPLIED) for name in estimates):
        return ()
    delivered = value("mean_output_power")
    if outside and delivered < min(0.0, 2.0 * value("mean_storage_power")):
        return (
            f"not between 0 and 1: {', '.join(outside)}: a source in the load feeds "
            f"{-delivered * power_scale:.3g} {unit} into its output, such as a constant-power sink "
            "with a collapsed voltage: the sink demands more than the device delivers; reduce it",
        )
    if outside:
        return (
            f"not between 0 and 1: {', '.join(outside)}: energy stored before the measured time "
            "was used during it; raise run.settle and run.duration",
        )
    return ()


def faint_output_notes(estimates: dict[str, Estimate]) -> tuple[str, ...]:
    """A note if the output is so small that its error may exceed `step_error`."""
    if "mean_output_power" not in estimates:
        return ()
    output_power, input_power = (
        estimates[f"mean_{name}_power"].estimate for name in ("output", "input")
    )
    supplied = any(name.startswith(SUPPLIED) for name in estimates)
    if supplied or not 0.0 < output_power < FAINT_OUTPUT * input_power:
        return ()
    return (
        f"the output power is {output_power / input_power:.1g} of the base's input power: steps "
        "may change it by some per cent; compare with step = finest",
    )


def supply_notes(estimates: dict[str, Estimate], power_scale: float, unit: str) -> tuple[str, ...]:
    """A note on the power from sources of a load; see `efficiency_notes`."""
    powers = {
        name.removeprefix(SUPPLIED): quantity(estimate.estimate * power_scale, unit, 3)
        for name, estimate in estimates.items()
        if name.startswith(SUPPLIED)
    }
    supplied = [f"supplied by {name}: {power}" for name, power in powers.items()]
    output = estimates.get("mean_output_power")
    nothing = output is not None and not output.estimate > 0.0
    voltage = estimates.get("output_voltage")
    advice = (
        "let a source draw this power from the load, controlled by the current of a 0 V source in "
        f"series with {', '.join(powers)}, as in docs/how-to/rectifier.md, 'Add a regulator'"
    )
    if voltage is not None and voltage.estimate < 0.0:
        advice = "the output voltage is below 0 V, since the load demands too much: reduce it"
    return bool(supplied) * (
        f"{', '.join(supplied)}, which does not come from the device and is not part of output "
        f"power and efficiencies{', so nothing is harvested there' * nothing}: {advice}",
    )


def source_notes(load: Any) -> tuple[str, ...]:
    """A note on parts of a load that might deliver energy, which would count as the piezo's."""
    if load is None:
        return ()
    sources = unbooked(load.elements) if load.has_output else load.sources
    kinds = (("sources", sources), ("values below 0", load.negative_parts))
    return tuple(
        f"the load has {kind} ({', '.join(parts[:5])}{' …' if parts[5:] else ''}): any "
        "energy that they deliver counts as the piezo's"
        for kind, parts in kinds
        if parts
    )
