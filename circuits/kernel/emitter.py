"""Symbolic numbers of generated code: written with Python's operators, compiled by LLVM.

A function of a circuit takes the circuit's memory (`circuits.kernel.memory`), an index in it and
three numbers, and returns a number. It is straight-line code except for `choose`. A number may be a
vector, for the processor's vector instructions.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from harvester.base.compilation import intrinsic, types

DOUBLE, INTEGER, INDEX = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
TYPE = ir.FunctionType(DOUBLE, [DOUBLE.as_pointer(), INTEGER, DOUBLE, DOUBLE, DOUBLE])


# Adding this rounds a number to an integer, stored in the last bits of the sum.
ROUNDING = 1.5 * 2.0**52
# ln 2 in two parts. The first has so few digits that its multiples are exact.
LN_2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
# Series coefficients of the exponential within ln 2/2 of 0, with a relative error of 6e-15.
SERIES = [1.0 / math.factorial(k) for k in range(12)]

# LLVM's time for machine code grows with the square of a function's length: 209,000 instructions
# took 64 s at level 1 and 1 s at level 0. The largest load of `netlists` has 14,000.
MOST_OPTIMIZED = 50_000


class Number:
    """A double, or a vector of doubles, computed when the code runs."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    @property
    def count(self) -> int:
        """Length of the vector; 0 for a scalar."""
        return getattr(self.value.type, "count", 0)

    def _with(self, operation, other):
        return Number(self.builder, operation(self.value, self._of(other), flags=("contract",)))

    def _of(self, other):
        if not isinstance(other, Number):
            return _constant(other, self.count)
        if self.count and not other.count:
            return beside([other] * self.count).value
        return other.value

    def __add__(self, other: Number | float) -> Number:
        return self._with(self.builder.fadd, other)

    def __sub__(self, other: Number | float) -> Number:
        return self._with(self.builder.fsub, other)

    def __mul__(self, other: Number | float) -> Number:
        return self._with(self.builder.fmul, other)

    def __truediv__(self, other: Number | float) -> Number:
        return self._with(self.builder.fdiv, other)

    def __rtruediv__(self, other: float) -> Number:
        return Number(self.builder, _constant(other, self.count)) / self

    def __neg__(self) -> Number:
        return Number(self.builder, self.builder.fneg(self.value, flags=("contract",)))

    def __gt__(self, other: Number | float) -> Any:
        return self.builder.fcmp_ordered(">", self.value, self._of(other))

    def __lt__(self, other: Number | float) -> Any:
        return self.builder.fcmp_ordered("<", self.value, self._of(other))

    def __le__(self, other: Number | float) -> Any:
        return self.builder.fcmp_ordered("<=", self.value, self._of(other))

    def where(self, condition: Any, other: Number) -> Number:
        """This number if a condition is true, else the other one; elementwise for vectors."""
        return Number(self.builder, self.builder.select(condition, self.value, other.value))

    def greater(self, other: Number | float) -> Number:
        """The larger of two numbers."""
        return Number(self.builder, self.builder.select(self > other, self.value, self._of(other)))

    def lesser(self, other: Number | float) -> Number:
        """The smaller of two numbers."""
        return Number(self.builder, self.builder.select(self < other, self.value, self._of(other)))

    def size(self) -> Number:
        """The absolute value."""
        return self.greater(-self)

    def parts(self) -> list[Number]:
        """The numbers of a vector, one by one."""
        return [
            Number(self.builder, self.builder.extract_element(self.value, ir.Constant(INDEX, k)))
            for k in range(self.count)
        ]

    def function(self, name: str, *others: Number) -> Number:
        """A mathematical function of LLVM: log or pow."""
        if self.count:
            columns = zip(self.parts(), *(other.parts() for other in others), strict=True)
            return beside([one.function(name, *operands) for one, *operands in columns])
        module = self.builder.module
        called = module.declare_intrinsic(f"llvm.{name}", [DOUBLE])
        if others:
            called.ftype.args = (DOUBLE,) * (1 + len(others))
        values = [self.value, *(other.value for other in others)]
        return Number(self.builder, self.builder.call(called, values))

    def exponential(self) -> Number:
        """The exponential of a number in [−700, 700]: an integer power of 2 times a series."""
        shifted = self * (1.0 / math.log(2.0)) + ROUNDING
        power_of_2 = shifted - ROUNDING
        power = self - power_of_2 * LN_2[0] - power_of_2 * LN_2[1]
        terms = [Number(self.builder, _constant(term, self.count)) for term in SERIES]
        while len(terms) > 1:
            pairs = zip(terms[::2], terms[1::2], strict=False)
            terms = [low + high * power for low, high in pairs] + terms[len(terms) & ~1 :]
            power = power * power
        bits = ir.VectorType(INTEGER, self.count) if self.count else INTEGER
        digits = self.builder.bitcast(shifted.value, bits)
        exponent = self.builder.shl(digits, _constant(52, self.count, INTEGER))
        total = self.builder.add(self.builder.bitcast(terms[0].value, bits), exponent)
        return Number(self.builder, self.builder.bitcast(total, self.value.type))


def _constant(value, count, kind=DOUBLE):
    if not count:
        return ir.Constant(kind, value)
    return ir.Constant(ir.VectorType(kind, count), [value] * count)


def beside(numbers: Sequence[Number]) -> Number:
    """A vector made of single numbers."""
    builder = numbers[0].builder
    value = ir.Constant(ir.VectorType(DOUBLE, len(numbers)), ir.Undefined)
    for k, number in enumerate(numbers):
        value = builder.insert_element(value, number.value, ir.Constant(INDEX, k))
    return Number(builder, value)


class Emitter:
    """Builder of one function's machine code."""

    def __init__(self, module: Any, name: str) -> None:
        self._function = ir.Function(module, TYPE, name)
        memory, self._slot, *numbers = self._function.args
        memory.add_attribute("noalias")
        self._memory = memory
        self.builder = ir.IRBuilder(self._function.append_basic_block())
        self.numbers = [Number(self.builder, argument) for argument in numbers]

    def constant(self, value: float, count: int = 0) -> Number:
        """A constant, or a vector of `count` equal constants."""
        return Number(self.builder, _constant(value, count))

    def load(self, place: int, in_slot: bool = False, count: int = 0) -> Number:
        """Load one or several numbers, at an index from the start of the memory or of the slot."""
        return Number(
            self.builder, self.builder.load(self._pointer(place, in_slot, count), align=8)
        )

    def store(self, place: int, number: Number, in_slot: bool = False) -> None:
        """Write a number, or several, into the memory."""
        self.builder.store(number.value, self._pointer(place, in_slot, number.count), align=8)

    def _pointer(self, place, in_slot, count):
        index = ir.Constant(INTEGER, place)
        if in_slot:
            index = self.builder.add(self._slot, index)
        pointer = self.builder.gep(self._memory, [index])
        kind = ir.VectorType(DOUBLE, count).as_pointer()
        return self.builder.bitcast(pointer, kind) if count else pointer

    def both(self, one: Any, other: Any) -> Any:
        """Whether two conditions are true."""
        return self.builder.and_(one, other)

    def any(self, conditions: Any) -> Any:
        """Whether any condition of a vector is true."""
        kind = ir.IntType(conditions.type.count)
        bits = self.builder.bitcast(conditions, kind)
        return self.builder.icmp_unsigned("!=", bits, ir.Constant(kind, 0))

    def all(self, conditions: Any) -> Any:
        """Whether all conditions of a vector are true."""
        return self.builder.not_(self.any(self.builder.not_(conditions)))

    def choose(
        self,
        condition: Any,
        then: Callable[[], Sequence[Number]],
        otherwise: Callable[[], Sequence[Number]],
    ) -> list[Number]:
        """Values of one of two branches of code; only the chosen branch runs."""
        ends = []
        with self.builder.if_else(condition) as branches:
            for branch, code in zip(branches, (then, otherwise), strict=True):
                with branch:
                    numbers = code()
                    ends.append((numbers, self.builder.block))
        chosen = []
        for pair in zip(*(numbers for numbers, _ in ends), strict=True):
            phi = self.builder.phi(pair[0].value.type)
            for number, (_, block) in zip(pair, ends, strict=True):
                phi.add_incoming(number.value, block)
            chosen.append(Number(self.builder, phi))
        return chosen

    def give(self, number: Number) -> None:
        """End the function and return a number."""
        self.builder.ret(number.value)

    def truth(self, condition: Any) -> Number:
        """1 if a condition is true, else 0."""
        return Number(self.builder, self.builder.uitofp(condition, DOUBLE))


def compile_module(module: Any) -> tuple[Any, dict[str, int]]:
    """Compile a module: the engine that owns its code, and its functions' addresses."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    parsed = llvm.parse_assembly(str(module))
    parsed.verify()
    blocks = [block for function in module.functions for block in function.blocks]
    level = 2 if sum(len(block.instructions) for block in blocks) < MOST_OPTIMIZED else 0
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=level
    )
    options = llvm.create_pipeline_tuning_options(speed_level=level)
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(parsed, passes)
    engine = llvm.create_mcjit_compiler(parsed, machine)
    engine.finalize_object()
    names = [function.name for function in module.functions if not function.is_declaration]
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
    typing_context: Any, address: Any, memory: Any, slot: Any, first: Any, second: Any, third: Any
) -> Any:
    """Call a function by its address, in compiled code; float of (int, int, int, 3 floats)."""

    def code(context, builder, signature, arguments):
        function, memory, *others = arguments
        function = builder.inttoptr(function, TYPE.as_pointer())
        memory = builder.inttoptr(memory, DOUBLE.as_pointer())
        return builder.call(function, [memory, *others])

    integers, floats = (types.int64,) * 3, (types.float64,) * 3
    return types.float64(*integers, *floats), code
