"""A device's mechanics as functions called by address, so that the solver is compiled only once.

Each kind of spring, damper and contacts requires only these few functions to be compiled; compiling
the solver too would take ten times as long.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from llvmlite import ir

from harvester.base.compilation import (
    address_of,
    cgutils,
    compiled,
    intrinsic,
    numba,
    numbers_of,
    types,
)
from harvester.device import contact
from harvester.device import spring as springs
from harvester.device import system as systems

if TYPE_CHECKING:
    from harvester.device.system import System


class Device(NamedTuple):
    """A device's transducer, its numbers and the addresses of its functions, for `evaluate`.

    Attributes
    ----------
    transducer : the equations of a transducer, see harvester.device.terminals
    numbers : ndarray
        All numbers of the `System`, in memory order.
    pull : function of (whether contacts are active, low, high, held speed, x, v)
        Spring, damper and, in the zone from low to high, contacts against the motion.
    contact_step : function of (x, v, noise, remaining, longest, steps)
        Step that resolves a contact at the speed gained until the knot, ≤ longest (s).
    loss_power : function of (x, v, held speed, whether a contact is active)
        Power lost in damper and contacts.
    """

    transducer: Any
    numbers: np.ndarray
    pull: int
    contact_step: int
    loss_power: int


def device_of(s: System) -> Device:
    """The device's functions for the solver, compiled at first use."""
    kind, addresses = types.CPointer(numba.typeof(s)), list[int]()
    for function in _FUNCTIONS:
        floats = (types.float64,) * (function.py_func.__code__.co_argcount - 1)
        addresses.append(address_of(function, kind, *floats))
    return Device(s.transducer, np.array(numbers_of(s)), *addresses)


@intrinsic
def evaluate(typing_context: Any, address: Any, numbers: Any, values: Any) -> Any:
    """Call a device's function by its address; float of (int, array, tuple of floats)."""

    def code(context, builder, signature, arguments):
        address, array, values = arguments
        at = context.make_array(signature.args[1])(context, builder, array).data
        floats = cgutils.unpack_tuple(builder, values)
        kind = ir.FunctionType(ir.DoubleType(), [at.type, *(argument.type for argument in floats)])
        return builder.call(builder.inttoptr(address, kind.as_pointer()), [at, *floats])

    return types.float64(types.int64, numbers, types.UniTuple(types.float64, len(values))), code


@intrinsic
def _at(typing_context, place):
    """Read the device from an address in memory."""

    def code(context, builder, signature, arguments):
        kind = context.get_value_type(signature.return_type)
        return builder.load(builder.bitcast(arguments[0], kind.as_pointer()))

    return place.dtype(place), code


@compiled
def _pull(place, touching, low, high, held, x, v):
    s = _at(place)
    total = springs.force(s.spring, x) + systems.part_force(s.damper, v)
    if touching > 0.0:
        total += systems.contact_force(s, x, v, held, low, high)
    return total


@compiled
def _contact_step(place, x, v, noise, remaining, longest, steps):
    s = _at(place)
    speed = abs(v) + abs(noise - systems.part_force(s.damper, v)) * remaining
    return contact.step(s.contacts, x, speed * speed, longest, steps)


@compiled
def _loss_power(place, x, v, held, touching):
    return systems.loss_power(_at(place), x, v, held, touching > 0.0)


_FUNCTIONS = (_pull, _contact_step, _loss_power)
