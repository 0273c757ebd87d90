"""Notes on an excitation are those of its own density between the samples."""

import pytest

from harvester.engines.outcome import notes_on_excitation
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

SPECTRUM = {
    "kind": "spectrum",
    "unit": "(m/s^2)^2/Hz",
    "breakpoints": [[20.0, 0.01], [150.0, 0.01]],
}
NOISE = {"kind": "ornstein-uhlenbeck", "intensity": 2e-3, "correlation_time": 2e-3}


@pytest.mark.parametrize(("excitation", "noted"), [(NOISE, True), (SPECTRUM, False)])
def test_only_noise_without_a_highest_frequency_moves_the_base_between_samples(excitation, noted):
    values = {"piezo.base_charge": 1e-10, "piezo.coupling": 1e-5, "piezo.capacitance": 3e-10}
    values |= {"load.resistance": 33e3, "excitation": excitation}
    notes = notes_on_excitation(prepared(Scene.read("cantilever").replace(values)))
    assert any("noise would raise the power" in note for note in notes) == noted
