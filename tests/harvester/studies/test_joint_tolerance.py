"""Parameters that scatter together: the devices drawn have the covariance that was given."""

import json

import numpy as np
import pytest

from harvester.base.errors import HarvesterError
from harvester.scene.model import Scene
from harvester.studies.sensitivity.tolerances import directions, parameters

KEYS = ["oscillator.damping", "piezo.coupling", "sensor.voltage_offset"]
ERRORS = np.array([1e-3, 2e-5, 0.1])
CORRELATION = np.array([[1.0, 0.8, 0.1], [0.8, 1.0, 0.0], [0.1, 0.0, 1.0]])
IDENTIFIED = {"keys": KEYS, "covariance": (CORRELATION * np.outer(ERRORS, ERRORS)).tolist()}


def test_devices_scatter_with_the_covariance_about_the_scene(tmp_path):
    scene = Scene.read("device")
    file = tmp_path / "identified.json"
    file.write_text(json.dumps(IDENTIFIED))
    axes = directions(scene, file)
    shares = np.random.default_rng(1).random((20_000, 2))
    drawn = np.array([list(parameters(axes, share).values()) for share in shares])
    assert list(parameters(axes, shares[0])) == KEYS[:2]
    # Five standard errors of 20 000 devices: false alarm below one in a million.
    middle = [scene.oscillator.damping, scene.transducer.coupling]
    assert np.abs(drawn.mean(axis=0) - middle) / ERRORS[:2] == pytest.approx(0.0, abs=0.036)
    found = np.cov(drawn.T) / np.outer(ERRORS[:2], ERRORS[:2])
    assert found == pytest.approx(CORRELATION[:2, :2], abs=0.05)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"keys": KEYS}, "not an identification"),
        ({"keys": KEYS, "covariance": [[1.0]]}, "must be a square matrix"),
        ({"keys": ["piezo.couplin"], "covariance": [[1.0]]}, r"did you mean piezo\.coupling"),
    ],
)
def test_what_is_no_covariance_is_refused(content, words):
    with pytest.raises(HarvesterError, match=words):
        directions(Scene.read("device"), content)
