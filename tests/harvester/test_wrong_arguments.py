"""Every option of every public function refuses what it cannot be, by its name and in one line."""

import inspect

import pytest

import harvester
from harvester.base.signatures import options_of

WRONG = (object(), [1, "x"], {"nope": 1}, "no-such-thing", -1.5)
# Values of the options without which a function cannot be called.
NEEDED = {
    "frequency_response": {"frequencies": [0.1], "amplitude": 0.1},
    "sweep": {"over": {"excitation.intensity": [0.1]}},
    "bifurcation": {"over": {"excitation.amplitude": [0.1, 0.2]}},
    "optimum": {"over": "load.decay_rate"},
    "reproduce": {"names": ["fig9"]},
    "sensitivity": {"vary": {"load.decay_rate": "±5%"}},
}
FORCED = ("basins", "bifurcation")
SINE = harvester.Scene.read("paper", ['excitation={kind="sine", amplitude=0.1, frequency=0.1}'])
# Checked once a record has been read.
AFTER_A_RECORD = {("identify", "free")}
FUNCTIONS = [
    name
    for name in harvester.__all__
    if inspect.isfunction(getattr(harvester, name))
    and "scene" in options_of(getattr(harvester, name))
]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_an_object_of_no_kind_is_refused_by_every_option(name):
    function, needed = getattr(harvester, name), NEEDED.get(name, {})
    for option in options_of(function):
        if option == "scene" or (name, option) in AFTER_A_RECORD:
            continue
        with pytest.raises(harvester.HarvesterError) as raised:
            function(SINE if name in FORCED else "paper", **{**needed, option: object()})
        message = str(raised.value)
        assert option in message or "object object" in message, (option, message)
        assert "\n" not in message
        assert "--" not in message


@pytest.mark.parametrize("wrong", WRONG, ids=["object", "list", "keys", "name", "number"])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_wrong_scene_is_refused(name, wrong):
    with pytest.raises(harvester.HarvesterError) as raised:
        getattr(harvester, name)(wrong, **NEEDED.get(name, {}))
    assert "\n" not in str(raised.value)
