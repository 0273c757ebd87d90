"""Numbers of machine code against numpy."""

import numpy as np
import pytest
from llvmlite import ir

from circuits.kernel.emitter import Emitter, beside, call_once, compile_module


@pytest.mark.parametrize("count", [0, 1, 5, 8])
def test_an_exponential_is_numpys(count):
    """Alone and side by side, to a few roundings."""
    module = ir.Module()
    e = Emitter(module, "exponentials")
    size = max(count, 1)
    e.store(size, e.load(0, count=count).exponential())
    e.give(e.constant(0.0))
    engine, addresses = compile_module(module)
    for value in np.linspace(-700.0, 700.0, 1001):
        memory = np.concatenate([value + 0.01 * np.arange(size), np.zeros(size)])
        memory[:size] = np.clip(memory[:size], -700.0, 700.0)
        call_once(addresses["exponentials"], memory.ctypes.data, 0)
        np.testing.assert_allclose(memory[size:], np.exp(memory[:size]), rtol=3e-14)
    del engine


def test_any_and_all_ask_those_side_by_side():
    module = ir.Module()
    e = Emitter(module, "asked")
    three = beside(e.numbers)
    e.store(0, e.truth(e.any(three > 0.0)))
    e.store(1, e.truth(e.all(three > 0.0)))
    e.give(e.constant(0.0))
    engine, addresses = compile_module(module)
    memory = np.zeros(2)
    for values in np.ndindex(2, 2, 2):
        call_once(addresses["asked"], memory.ctypes.data, 0, *map(float, values))
        assert memory.tolist() == [any(values), all(values)]
    del engine
