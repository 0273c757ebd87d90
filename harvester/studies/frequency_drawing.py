"""The figure of `harvester frequency-response`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.studies.frequency_response import FrequencyResponse

UP, DOWN = ("#0072B2", "-", ">"), ("#D55E00", "--", "<")


def draw(response: FrequencyResponse) -> Figure:
    """Amplitude, rms voltage and mean power over frequency, up and down."""
    from matplotlib.figure import Figure

    from harvester.studies.frequency_response import NOTED_RESIDUAL, QUANTITIES

    figure = Figure(figsize=(9.0, 3.0))
    for place, (name, dimension) in enumerate(QUANTITIES.items()):
        axes = figure.add_subplot(1, len(QUANTITIES), place + 1)
        for sweep in response.sweeps:
            colour, style, marker = UP if sweep.direction == "up" else DOWN
            values = response.values(name, sweep)
            axes.plot(
                response.frequencies,
                values,
                style,
                color=colour,
                label=f"sweep {sweep.direction}",
            )
            unsettled = ~(sweep.residual <= NOTED_RESIDUAL)
            axes.plot(
                response.frequencies[unsettled],
                values[unsettled],
                marker,
                color=colour,
                markersize=4,
                markerfacecolor="none",
            )
        # Over less than a decade a log axis has no room for its labels.
        wide = response.frequencies[-1] > 10.0 * response.frequencies[0]
        axes.set_xscale("log" if wide else "linear")
        axes.set_yscale("log")
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel(f"{name.replace('_', ' ')} [{response.unit(dimension)}]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.suptitle(
        f"{response.scene.name}: {response.engine} (hollow marks: not periodic or not settled)",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    return figure
