import numpy as np
import pytest

from harvester.averaging.of_scene import average
from harvester.base.errors import AveragingError, UnknownQuantity
from harvester.device import timescales
from harvester.scene.model import Scene


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["paper", "consistent"])
@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["excitation.intensity=1e-6"],
        ["stoppers.stiffness=1e6", "stoppers.gap=0.5", "excitation.correlation_time=1e-3"],
        ["excitation.intensity=100"],
    ],
)
def test_densities_are_tabulated_where_they_are_however_narrow(closure, overrides):
    result = average(Scene.read("paper", overrides), method=closure)
    for name, density in result.densities.items():
        assert np.all(np.diff(density.centre) > 0.0)
        mass = np.trapezoid(density.density, density.centre)
        square = np.trapezoid(density.density * density.centre**2, density.centre)
        assert mass == pytest.approx(1.0, abs=0.02)
        mean = result.scaled_quantities[f"mean_square_{name}"].estimate
        assert square == pytest.approx(mean, rel=0.02)


@pytest.mark.parametrize("closure", ["paper", "consistent"])
def test_a_note_names_the_weakest_premise(closure):
    """Frequent jumps between the wells; a linear device, whose ratio is known."""
    (note,) = average(Scene.read("paper", ["excitation.intensity=0.1"]), method=closure).notes
    assert note.startswith(f"{closure}: ± is the numerical error alone")
    assert "weakest premise: mean energy E[X'²] over the barrier = " in note
    linear = average(Scene.read("linear"), method=closure)
    system = linear.prepared_scene.system
    period = 2.0 * np.pi / timescales.loaded_frequency(system)
    rate = timescales.loss_rate(system, timescales.loaded_frequency(system))
    name, _, value = (
        linear.notes[0].partition("premise: ")[2].partition(", which")[0].partition(" = ")
    )
    assert name == "mean period over the relaxation time of the energy"
    assert float(value) == pytest.approx(period * rate, rel=0.05)


def test_jump_rates_are_refused_or_the_option_is_named():
    with pytest.raises(AveragingError, match="jump_rates: consistent computes none; use the"):
        average(Scene.read("paper"), method="consistent", jump_rates=True)
    result = average(Scene.read("paper"), method="consistent")
    with pytest.raises(UnknownQuantity, match=r"jump_rates=True\) by fokker_planck"):
        result["jump_rate"]
    with pytest.raises(UnknownQuantity, match=r"there are|did you mean"):
        average(Scene.read("linear"))["jump_rate"]
