"""One protocol for whatever a command shows."""

import inspect

import pytest

from harvester.cli.shown import Shown, Tabled
from harvester.identification.identification import Identification
from harvester.results.result import Result
from harvester.studies.comparison.comparison import Comparison
from harvester.studies.frequency_response import FrequencyResponse
from harvester.studies.loads.study import LoadStudy
from harvester.studies.optimum.result import Optimum
from harvester.studies.sensitivity.study import Sensitivity
from harvester.studies.sweep import Sweep
from harvester.validation import orbit_maps
from harvester.validation.accuracy import Accuracy
from harvester.validation.claims import ReproducedStatements
from harvester.validation.reproduce import Reproduction
from harvester.validation.stability import StabilityMatrix
from harvester.validation.verify import Verification

SHOWN = [
    Accuracy,
    Comparison,
    FrequencyResponse,
    Identification,
    ReproducedStatements,
    Optimum,
    Reproduction,
    Result,
    Sensitivity,
    StabilityMatrix,
    LoadStudy,
    Sweep,
    Verification,
    orbit_maps.OrbitVoltages,
    orbit_maps.Surfaces,
]
METHODS = [
    name
    for kind in (Shown, Tabled)
    for name, member in vars(kind).items()
    if inspect.isfunction(member) and not name.startswith("_")
]


def test_the_protocol_has_its_parts():
    assert set(METHODS) == {"table", "sentences", "to_dict", "figure"}


@pytest.mark.parametrize("kind", SHOWN, ids=lambda kind: f"{kind.__module__}.{kind.__name__}")
def test_every_result_has_all_of_it(kind):
    for name in METHODS:
        assert inspect.isfunction(inspect.getattr_static(kind, name)), name
    assert hasattr(kind, "scene") or "scene" in kind.__dataclass_fields__
