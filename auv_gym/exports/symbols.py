"""Physics on symbols of CasADi: the same source, run once with symbols instead of numbers.

`on_symbols` rebuilds a function, and those that it calls, on CasADi's mathematics.  If a branch in the source depends
on a symbol, both branches are run and joined by `casadi.if_else`, one function at a time, so that the branches of one
function do not multiply with those of the next.
"""

from __future__ import annotations

import builtins
import math
import operator
import types
from collections.abc import Callable
from typing import Any

import numpy as np

from auv_gym.extra import needs

with needs("A CasADi function needs casadi", "casadi"):
    import casadi as ca


# Added under a root, which makes its slope at 0 finite and changes its value by at most 1e-15.
_UNDER_ROOTS = 1e-30
_MOST_CONDITIONS = 8  # in one run of one function; each doubles the number of runs


class Symbol:
    """A number that is an expression of CasADi."""

    __slots__ = ("value",)

    def __init__(self, value: Any):
        self.value = value

    def __bool__(self) -> bool:
        return _branches[-1].choose(self.value)

    def __hash__(self) -> int:
        return id(self)

    def __neg__(self) -> Symbol:
        return Symbol(-self.value)

    def __pos__(self) -> Symbol:
        return self

    def __abs__(self) -> Symbol:
        return Symbol(ca.fabs(self.value))

    def __array_ufunc__(self, ufunc: Any, method: str, *numbers: Any, **_: Any) -> Any:
        """Apply numpy functions, and arithmetic of numpy numbers with a symbol."""
        return _of_numpy(ufunc)(*(n if isinstance(n, Symbol) else float(n) for n in numbers))


def _plain(number: Any) -> Any:
    return number.value if isinstance(number, Symbol) else float(number)


def _of(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of CasADi as a function of symbols; numbers alone give a constant symbol."""
    return lambda *numbers: Symbol(function(*map(_plain, numbers)))


for _name in ("add", "sub", "mul", "truediv", "pow"):
    _operator = getattr(ca.SX, f"__{_name}__")
    setattr(Symbol, f"__{_name}__", lambda a, b, op=_operator: Symbol(op(ca.SX(_plain(a)), _plain(b))))
    setattr(Symbol, f"__r{_name}__", lambda a, b, op=_operator: Symbol(op(ca.SX(_plain(b)), _plain(a))))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    _operator = getattr(ca.SX, f"__{_name}__")
    setattr(Symbol, f"__{_name}__", lambda a, b, op=_operator: Symbol(op(ca.SX(_plain(a)), _plain(b))))


def _or_plain(plain: Callable[..., Any], symbolic: Callable[..., Any]) -> Callable[..., Any]:
    """The plain function if no argument is a symbol, else the symbolic one."""

    def function(*numbers: Any) -> Any:
        return symbolic(*numbers) if any(isinstance(n, Symbol) for n in numbers) else plain(*numbers)

    return function


def _truncated(x: Any) -> Any:
    return ca.sign(x) * ca.floor(ca.fabs(x))


def _folded(function: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    def fold(first: Any, *others: Any) -> Any:
        for other in others:
            first = function(first, other)
        return first

    return fold


_MATHEMATICS: dict[Any, Any] = {
    math.sqrt: _or_plain(math.sqrt, _of(lambda x: ca.sqrt(x + _UNDER_ROOTS))),
    builtins.min: _or_plain(min, _of(_folded(ca.fmin))),
    builtins.max: _or_plain(max, _of(_folded(ca.fmax))),
    builtins.int: _or_plain(int, _of(_truncated)),
    **{
        getattr(math, name): _or_plain(getattr(math, name), _of(getattr(ca, name)))
        for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sinh", "cosh", "tanh")
        + ("floor", "ceil", "expm1", "log1p", "hypot", "copysign")
    },
}
# numpy functions whose names differ from Python's
_NUMPY_NAMES = {
    "subtract": "sub",
    "multiply": "mul",
    "divide": "truediv",
    "power": "pow",
    "less": "lt",
    "less_equal": "le",
    "greater": "gt",
    "greater_equal": "ge",
    "equal": "eq",
    "not_equal": "ne",
    **{f"arc{name}": f"a{name}" for name in ("sin", "cos", "tan", "tan2")},
}


def _of_numpy(ufunc: Any) -> Callable[..., Any]:
    known = str(ufunc.__name__)
    name = _NUMPY_NAMES.get(known, known)
    return _MATHEMATICS[getattr(math, name)] if hasattr(math, name) else getattr(operator, name)


_BUILTINS = {
    function.__name__: changed for function, changed in _MATHEMATICS.items() if hasattr(builtins, function.__name__)
}


class _Fork(Exception):
    """A condition whose outcome has not been chosen yet."""

    def __init__(self, condition: Any):
        super().__init__()
        self.condition = condition


class _Branch:
    """The outcomes that one run of a function takes, in the order of its conditions."""

    def __init__(self, choices: tuple[bool, ...]):
        self.choices, self.met = choices, 0

    def choose(self, condition: Any) -> bool:
        condition = ca.SX(condition)
        if condition.is_constant():
            return bool(float(condition))
        if self.met == len(self.choices):
            if self.met == _MOST_CONDITIONS:
                raise ValueError(
                    "its physics searches for a balance step by step, which no CasADi function can contain"
                )
            raise _Fork(condition)
        self.met += 1
        return self.choices[self.met - 1]


_branches: list[_Branch] = []


def _joined(condition: Any, yes: Any, no: Any) -> Any:
    """The value `yes` if the condition holds, else `no`: numbers, tuples of them, or arrays."""
    if yes is no or (isinstance(yes, float) and yes == no):
        return yes
    if isinstance(yes, np.ndarray):
        return np.array([_joined(condition, a, b) for a, b in zip(yes, no, strict=True)], dtype=object)
    if isinstance(yes, tuple):
        joined = [_joined(condition, a, b) for a, b in zip(yes, no, strict=True)]
        return type(yes)(*joined) if hasattr(yes, "_fields") else tuple(joined)
    return Symbol(ca.if_else(condition, _plain(yes), _plain(no)))


def _branching(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with both branches of every condition, also for values written into its arrays."""

    def call(*arguments: Any) -> Any:
        arrays = [a for a in arguments if isinstance(a, np.ndarray) and a.dtype == object]
        before = [a.copy() for a in arrays]

        def run(choices: tuple[bool, ...]) -> Any:
            for array, given in zip(arrays, before):
                array[:] = given
            _branches.append(_Branch(choices))
            try:
                return function(*arguments), *(a.copy() for a in arrays)
            except _Fork as fork:
                condition = fork.condition
            finally:
                _branches.pop()
            return _joined(condition, run((*choices, True)), run((*choices, False)))

        result, *written = run(())
        for array, filled in zip(arrays, written):
            array[:] = filled
        return result

    return call


_rebuilt: dict[int, tuple[Any, Callable[..., Any]]] = {}  # by id; keeping the function prevents reuse of its id


def on_symbols(function: Any) -> Callable[..., Any]:
    """A function of the physics as a function of `Symbol`s and arrays of them (dtype object)."""
    if id(function) in _rebuilt:
        return _rebuilt[id(function)][1]
    source = getattr(function, "py_func", function)
    space: dict[str, Any] = {**source.__globals__, **_BUILTINS}
    rebuilt = types.FunctionType(source.__code__, space, source.__name__, source.__defaults__)
    _rebuilt[id(function)] = function, _branching(rebuilt)
    for name in source.__code__.co_names:
        value = space.get(name)
        try:
            known = value in _MATHEMATICS
        except TypeError:  # unhashable objects are not functions
            continue
        if known:
            space[name] = _MATHEMATICS[value]
        elif (isinstance(value, types.FunctionType) or hasattr(value, "py_func")) and name not in _BUILTINS:
            space[name] = on_symbols(value)
    return _rebuilt[id(function)][1]


class _Table(np.ndarray):
    """Numbers that may be indexed by a symbol."""

    def __getitem__(self, key: Any) -> Any:
        if not isinstance(key, Symbol):
            return super().__getitem__(key)
        values = [float(v) for v in np.asarray(self)]
        return Symbol(ca.conditional(key.value, [ca.SX(v) for v in values[:-1]], ca.SX(values[-1]), False))


class Numbers:
    """A record of numbers in the form of the physics, whose tables may be indexed by a symbol."""

    def __init__(self, record: Any):
        self._record = record

    def __getattr__(self, name: str) -> Any:
        return _seen(getattr(self._record, name))


def _seen(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if value.dtype.names is not None:
            return [Numbers(entry) for entry in value]
        return value.view(_Table) if value.dtype == np.float64 else value
    if isinstance(value, list):
        return [Numbers(entry) for entry in value]
    return Numbers(value) if isinstance(value, np.record | types.SimpleNamespace) else value
