"""Numbers of machine code yet to be made: written with Python's operators, compiled by LLVM.

A function of a circuit takes the circuit's memory (`circuits.kernel.memory`), a place in it and
three numbers, and gives a number. It is straight-line code but for `choose`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from harvester.compilation import intrinsic, types

DOUBLE, INTEGER = ir.DoubleType(), ir.IntType(64)
TYPE = ir.FunctionType(DOUBLE, [DOUBLE.as_pointer(), INTEGER, DOUBLE, DOUBLE, DOUBLE])


class Number:
    """A double that the code computes when it runs."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def _with(self, operation, other):
        return Number(self.builder, operation(self.value, self._of(other), flags=("contract",)))

    def _of(self, other):
        return other.value if isinstance(other, Number) else ir.Constant(DOUBLE, float(other))

    def __add__(self, other: Number | float) -> Number:
        return self._with(self.builder.fadd, other)

    def __sub__(self, other: Number | float) -> Number:
        return self._with(self.builder.fsub, other)

    def __mul__(self, other: Number | float) -> Number:
        return self._with(self.builder.fmul, other)

    def __truediv__(self, other: Number | float) -> Number:
        return self._with(self.builder.fdiv, other)

    def __rtruediv__(self, other: float) -> Number:
        return Number(self.builder, ir.Constant(DOUBLE, other)) / self

    def __neg__(self) -> Number:
        return Number(self.builder, self.builder.fneg(self.value, flags=("contract",)))

    def __gt__(self, other: Number | float) -> Any:
        return self.builder.fcmp_ordered(">", self.value, self._of(other))

    def __lt__(self, other: Number | float) -> Any:
        return self.builder.fcmp_ordered("<", self.value, self._of(other))

    def __le__(self, other: Number | float) -> Any:
        return self.builder.fcmp_ordered("<=", self.value, self._of(other))

    def greater(self, other: Number | float) -> Number:
        """The greater of two."""
        return Number(self.builder, self.builder.select(self > other, self.value, self._of(other)))

    def lesser(self, other: Number | float) -> Number:
        """The lesser of two."""
        return Number(self.builder, self.builder.select(self < other, self.value, self._of(other)))

    def function(self, name: str, *others: Number) -> Number:
        """One of LLVM's: exp, log, pow, fabs."""
        module = self.builder.module
        called = module.declare_intrinsic(f"llvm.{name}", [DOUBLE])
        if others:
            called.ftype.args = (DOUBLE,) * (1 + len(others))
        values = [self.value, *(other.value for other in others)]
        return Number(self.builder, self.builder.call(called, values))


class Emitter:
    """One function as it is written."""

    def __init__(self, module: Any, name: str) -> None:
        self._function = ir.Function(module, TYPE, name)
        memory, self._slot, *numbers = self._function.args
        memory.add_attribute("noalias")
        self._memory = memory
        self.builder = ir.IRBuilder(self._function.append_basic_block())
        self.numbers = [Number(self.builder, each) for each in numbers]

    def constant(self, value: float) -> Number:
        """A number known now."""
        return Number(self.builder, ir.Constant(DOUBLE, value))

    def load(self, place: int, in_slot: bool = False) -> Number:
        """A number of the memory, counted from its beginning or from the slot's."""
        return Number(self.builder, self.builder.load(self._pointer(place, in_slot)))

    def store(self, place: int, number: Number, in_slot: bool = False) -> None:
        """Write a number into the memory."""
        self.builder.store(number.value, self._pointer(place, in_slot))

    def _pointer(self, place, in_slot):
        index = ir.Constant(INTEGER, place)
        if in_slot:
            index = self.builder.add(self._slot, index)
        return self.builder.gep(self._memory, [index])

    def both(self, one: Any, other: Any) -> Any:
        """Whether two conditions hold."""
        return self.builder.and_(one, other)

    def choose(
        self,
        condition: Any,
        then: Callable[[], Sequence[Number]],
        otherwise: Callable[[], Sequence[Number]],
    ) -> list[Number]:
        """The numbers of one of two pieces of code, of which only that one runs."""
        ends = []
        with self.builder.if_else(condition) as branches:
            for branch, code in zip(branches, (then, otherwise), strict=True):
                with branch:
                    numbers = code()
                    ends.append((numbers, self.builder.block))
        chosen = []
        for pair in zip(*(numbers for numbers, _ in ends), strict=True):
            phi = self.builder.phi(DOUBLE)
            for number, (_, block) in zip(pair, ends, strict=True):
                phi.add_incoming(number.value, block)
            chosen.append(Number(self.builder, phi))
        return chosen

    def give(self, number: Number) -> None:
        """End the function with a number."""
        self.builder.ret(number.value)

    def truth(self, condition: Any) -> Number:
        """1 where a condition holds, else 0."""
        return Number(self.builder, self.builder.uitofp(condition, DOUBLE))


def compile_module(module: Any) -> tuple[Any, dict[str, int]]:
    """A module's machine code, to be kept as long as it is called, and its functions' addresses."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    parsed = llvm.parse_assembly(str(module))
    parsed.verify()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=2
    )
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(parsed, passes)
    engine = llvm.create_mcjit_compiler(parsed, machine)
    engine.finalize_object()
    names = [each.name for each in module.functions if not each.is_declaration]
    return engine, {name: engine.get_function_address(name) for name in names}


def call_once(
    address: int, memory: int, slot: int, first: float = 0.0, second: float = 0.0,
    third: float = 0.0,
) -> float:  # fmt: skip
    """Call a function by its address, from Python."""
    double = ctypes.c_double
    kind = ctypes.CFUNCTYPE(double, ctypes.c_void_p, ctypes.c_int64, double, double, double)
    return kind(address)(memory, slot, first, second, third)


@intrinsic
def call(
    typing_context: Any,
    address: Any,
    memory: Any,
    slot: Any,
    first: Any,
    second: Any,
    third: Any,
) -> Any:
    """Call a function by its address, in compiled code; float of (int, int, int, 3 floats)."""

    def code(context, builder, signature, arguments):
        function, memory, *others = arguments
        function = builder.inttoptr(function, TYPE.as_pointer())
        memory = builder.inttoptr(memory, DOUBLE.as_pointer())
        return builder.call(function, [memory, *others])

    integers, floats = (types.int64,) * 3, (types.float64,) * 3
    return types.float64(*integers, *floats), code
