import warnings

import numpy as np
import pytest
from raw_files import run_raw


def test_the_reader_agrees_with_an_independent_one(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own imports
        reader = pytest.importorskip("spicelib", reason="spicelib, the other reader, is missing")
    (tmp_path / "a.cir").write_text(
        "* decay\nC1 one 0 1u ic=2\nR1 one two 1k\nL1 two 0 1m\n.save v(one) v(two) i(L1)\n"
        ".tran 10u 5m uic\n.end\n"
    )
    ours = run_raw(tmp_path, "a.cir")
    theirs = reader.RawRead(str(tmp_path / "out.raw"), dialect="ngspice", verbose=False)
    assert list(ours) == theirs.get_trace_names()
    assert ours["v(one)"].size > 100
    for name, values in ours.items():
        np.testing.assert_array_equal(values, theirs.get_trace(name).get_wave())
