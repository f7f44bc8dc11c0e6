"""Physics as plain Python or as machine code: `compiled`, `bind` and the flat parameter view.

Set `AUV_GYM_JIT=0` to run every compiled function as ordinary Python (slow, but a debugger can step through it).
`AUV_GYM_CACHE` moves the folder of compiled code, by default `~/.cache/auv-gym`.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
import time
import types
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from functools import cached_property, lru_cache
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

JIT = os.environ.get("AUV_GYM_JIT", "1") != "0"
_GENERATIONS_KEPT = 6
_LONG = 80  # longest name before it is cut: file names have at most 255 characters
_STARTED = time.time()

F = TypeVar("F", bound=Callable[..., Any])
OPEN: Any = None  # an open name of a template, to which `bind` gives a value


def compiled(function: F) -> F:
    """The function as machine code, cached on disk; the function itself with `AUV_GYM_JIT=0`.

    fastmath is never used: the plain and the compiled form agree to rounding.  Calls are inlined, which halves a
    rollout's time: small functions would spend most of theirs on counting references to their arrays.
    """
    return _later(function, [function]) if JIT else function


def threads() -> int:
    """The number of threads that may run compiled code in parallel: numba's, or 1 in plain Python."""
    return int(_numba().get_num_threads()) if JIT else 1


def outlined(function: F) -> F:
    """Like `compiled`, but not inlined: for long, rarely called functions, which are then optimised once."""
    return _later(function, [function], forceinline=False) if JIT else function


class Later:
    """A function that is passed to numba on first use, so that modules load without numba; called in the same way.

    ready: numba's own function, without the look-up in this class.  within: the same for use in compiled code, which
    Python cannot call; the wrapper for Python takes a quarter of the time of compiling a vehicle.
    """

    def __init__(self, make: Callable[[bool], Any], function: Any):
        """make: returns numba's function, given whether it is for compiled code."""
        self._make = make
        self.py_func, self.__name__, self.__doc__ = function, function.__name__, function.__doc__
        self.__module__ = function.__module__

    @cached_property
    def ready(self) -> Any:
        return self._make(False)

    @cached_property
    def within(self) -> Any:
        return self._make(True)

    def __call__(self, *arguments: Any) -> Any:
        return self.ready(*arguments)


def ready(function: Any) -> Any:
    """The form of a compiled function that is fastest for repeated calls from Python."""
    return function.ready if isinstance(function, Later) else function


@lru_cache
def _numba() -> Any:
    """numba, set up to accept `Later` functions and to tell record types apart."""
    numba: Any = import_module("numba")
    import_module("numba.extending").typeof_impl.register(Later)(lambda value, context: numba.typeof(value.within))
    # Symbols of machine code name a record type by a number that each process counts by itself.  Code for one vehicle
    # from one process and for another vehicle from another could share a symbol, and one would be called for both.
    numba.types.Record.mangling_args = property(lambda record: ("Record", (_digest(record.name),)))
    return numba


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _later(function: Any, calls: Iterable[Any], **options: Any) -> Any:
    return Later(lambda within: _compiled(function, calls, within, **options), function)


def _compiled(function: Any, calls: Iterable[Any], within: bool, **options: Any) -> Any:
    """numba's function; within: see `Later`.  Each kind has its own cache, as numba does not tell them apart."""
    numba = _numba()
    # numba reads the cache folder when a function is decorated, so other packages' functions keep theirs.
    before = numba.config.CACHE_DIR
    folder = _cache_folder(frozenset(_package_folder(callee) for callee in calls))
    numba.config.CACHE_DIR = str(folder / "within" if within else folder)
    try:
        settings = {"cache": True, "error_model": "numpy", "forceinline": True, "no_cfunc_wrapper": True, "nogil": True}
        settings |= {"no_cpython_wrapper": within, **options}
        made = numba.njit(**settings)(function)
    finally:
        numba.config.CACHE_DIR = before
    # With numbers alone, two processes that compile for two signatures at once would write to one file: an entry of the
    # index would then point to the other's code.
    files = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if files is not None:
        files._data_name = lambda number: f"{files._index_name.removesuffix('.nbi')}.{os.getpid()}-{number}.nbc"
    return made


def bind(
    template: Callable[..., Any], name: str, *, inline: bool = True, parallel: bool = False, **meanings: Any
) -> Any:
    """The template compiled with values for its open global names, e.g. `bind(rk4, "glider", derivative=f)`.

    One source serves every vehicle family, and each family's code is compiled when first called and cached for the next
    start (functions passed as arguments would be compiled again by every process).
    A value is a number, a function or a `namespace` of functions.  inline: see `outlined`.  parallel: the template's
    open name `prange` shares a loop among all cores; in plain Python it is `range`.
    """
    if parallel:
        meanings = {**meanings, "prange": _numba().prange if JIT else range}
    source: Any = getattr(template, "py_func", template)
    known = name if len(name) <= _LONG else f"{name[:_LONG]}_{_digest(name)[:8]}"  # also the name of files
    bound_name = f"{source.__name__}_{known}"
    bound = types.FunctionType(source.__code__, {**source.__globals__, **meanings}, bound_name, source.__defaults__)
    bound.__qualname__ = bound_name
    bound.__module__ = source.__module__
    bound.__doc__ = source.__doc__
    if not JIT:
        return bound
    options = {"forceinline": inline and not parallel, "parallel": parallel}
    spaces = [vars(meaning).values() for meaning in meanings.values() if isinstance(meaning, types.ModuleType)]
    return _later(bound, [bound, *filter(callable, chain(meanings.values(), *spaces))], **options)


def namespace(functions: Any) -> Any:
    """A dataclass's fields as one value for `bind`, so that templates call `hooks.aim(...)`."""
    found = types.ModuleType(type(functions).__name__)  # numba treats its attributes as constants
    vars(found).update({field.name: getattr(functions, field.name) for field in fields(functions)})
    return found


def for_vector(program: Any) -> Callable[[np.ndarray], Any]:
    """A compiled program of one contiguous float64 vector, without looking up its argument's type at each call."""
    if not JIT:
        return program
    types_: Any = import_module("numba.core.types")
    return ready(program).compile((types_.float64[::1],))  # a signature given as a string would be cached separately


def view_as(dtype: np.dtype, name: str, *, writable: bool = False) -> Any:
    """A compiled function from a flat float64 vector to the record at its start: `view(p).hull.mass`, no copy.

    writable: whether assignments to the record's fields change the vector in plain Python, too.
    """
    size = dtype.itemsize // 8
    if not JIT and writable:
        return lambda vector: vector[:size].view(dtype)[0]
    if not JIT:  # attribute access takes a microsecond on a numpy record, and a tenth of that on a namespace
        return lambda vector: _with_tail(_namespace(dtype, iter(vector[:size].tolist())), vector[size:])
    layout = _digest(repr(dtype))[:8]  # two layouts with the same name are two functions
    return bind(_view, f"{name}_{layout}", RECORD=dtype, SIZE=size)


def _tail_of(within: bool) -> Any:
    numba = _numba()
    types_: Any = import_module("numba.core.types")
    intrinsic: Any = import_module("numba.extending").intrinsic

    @intrinsic
    def after(context, record):
        def generate(target, builder, signature, arguments):
            size = target.get_constant(types_.intp, record.size)
            number = target.get_value_type(types_.float64).as_pointer()
            start = builder.bitcast(arguments[0], target.get_value_type(types_.int8).as_pointer())
            return builder.bitcast(builder.gep(start, [size]), number)

        return types_.CPointer(types_.float64)(record), generate

    def tail_of(record, count):
        return numba.carray(after(record), (count,))

    return numba.njit(forceinline=True, no_cfunc_wrapper=True, no_cpython_wrapper=within)(tail_of)


def _plain_tail_of(record, count):
    return record.tail[:count]


# tail_of(record, count): the `count` numbers that follow the record of a vector longer than it, (count,), no copy, and
# no references counted: the vector must be kept elsewhere, and the record be one that compiled code made by its view. A
# record that has been through Python is a copy, with nothing behind it.
tail_of: Any = Later(_tail_of, _plain_tail_of) if JIT else _plain_tail_of


def _with_tail(record: Any, tail: np.ndarray) -> Any:
    record.tail = tail
    return record


def _namespace(dtype: np.dtype, values: Iterator[float]) -> Any:
    if dtype.subdtype is not None and dtype.base.fields is not None:
        return [_namespace(dtype.base, values) for _ in range(int(np.prod(dtype.shape)))]
    if dtype.subdtype is not None:  # of whole numbers, which lie in the vector as they are, the bits
        return np.array([next(values) for _ in range(int(np.prod(dtype.shape)))]).view(dtype.base).reshape(dtype.shape)
    if dtype.fields is None:
        return next(values)
    return types.SimpleNamespace(**{name: _namespace(dtype[name], values) for name in dtype.names or ()})


RECORD, SIZE = np.dtype(np.float64), 1


def _view(vector):
    return vector[:SIZE].view(RECORD)[0]


def _package_folder(function: Callable[..., Any]) -> Path:
    package = (function.__module__ or "").partition(".")[0]
    file = getattr(sys.modules.get(package), "__file__", None)
    return Path(file).parent if file else Path(__file__).parent


@lru_cache
def _cache_folder(packages: frozenset[Path]) -> Path:
    """The folder for code compiled from the sources in these packages; any edit in them starts a new one.

    numba checks only the file of the function that it loads, so it would keep a caller after a change of its callee.
    """
    digest = hashlib.sha256(sys.version.encode())
    for folder in sorted(packages | {Path(__file__).parent}):
        for path in sorted(folder.rglob("*.py")):
            text = path.read_bytes()
            if path.stat().st_mtime > _STARTED:  # the loaded source may be older
                digest.update(f"{os.getpid()} {_STARTED}".encode())
            # a view depends on the layout of its record: that of a parameter tree, or of an environment's numbers
            if any(word in text for word in (b"compiled", b"param(", b"Layout(")):
                digest.update(str(path.relative_to(folder)).encode() + b"\0" + text)
    roots = [os.environ.get("AUV_GYM_CACHE"), os.environ.get("XDG_CACHE_HOME"), os.path.expanduser("~/.cache")]
    for root in [Path(root) / "auv-gym" for root in roots if root]:
        folder = root / "compiled" / digest.hexdigest()[:16]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            _forget_old_generations(folder.parent)
            return folder
    # Not a fixed place that other users can write to: cached code is executed.
    folder = Path(tempfile.mkdtemp(prefix="auv-gym-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _forget_old_generations(root: Path) -> None:
    try:
        by_age = sorted((f for f in root.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime, reverse=True)
    except OSError:
        return
    for folder in by_age[_GENERATIONS_KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)
