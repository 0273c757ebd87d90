"""How narrow a density is."""

import numpy as np
import pytest

from harvester.averaging.region import _widths


def test_widths_of_a_density():
    """Of a normal density both are its deviation; a steep side is told from the peak's width."""
    x = np.linspace(-5.0, 5.0, 201)
    assert _widths(x, np.exp(-0.5 * (x / 0.7) ** 2)) == pytest.approx((0.7, 0.7), rel=0.02)
    narrow, steep = _widths(x, np.exp(-0.5 * (x / np.where(x > 0.0, 0.2, 1.0)) ** 2))
    assert narrow == pytest.approx(0.6, rel=0.03)
    assert steep == pytest.approx(0.2, rel=0.1)
