"""Compilation of kernels by numba, once per machine, and their machine code on disk, outside of the package.

Damaged files of machine code are deleted and compiled again. If machine code cannot be stored, every process compiles. Both cases
are reported.
"""

from __future__ import annotations

import gc
import pickle
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryFile
from time import monotonic
from typing import Any, TypeAlias, TypeVar

import numba
import numpy as np
from numba.core import serialize
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.event import Listener, register
from numba.core.registry import CPUDispatcher
from numba.core.types import NoneType
from numba.extending import overload
from numpy.typing import NDArray
from platformdirs import user_cache_path

from ..about import launched, versions
from ..errors import log

Ids: TypeAlias = NDArray[Any]
Reals: TypeAlias = NDArray[np.floating[Any]]
Function = TypeVar("Function", bound=Callable[..., Any])

#: Sums may be reordered and contracted. NaN and infinity keep their meaning, so that overflow is detected. A difference that must
#: be taken first is stored in an array, such as the difference of displacements before it is added to that of coordinates. Within
#: one expression LLVM may reorder the operations.
FASTMATH = {"reassoc", "contract", "nsz", "arcp"}


LENGTH = sha256().digest_size
_reported: set[str] = set()


NOT_STORED = "every process compiles again, because no cache folder is writable. Set NUMBA_CACHE_DIR to a writable folder"


class FirstUse(Listener):
    """Messages on the time of the first call: one when compilation starts, once per process, then one every few seconds.

    Attributes
    ----------
    count
        Number of kernels compiled in this process.
    quiet
        Whether messages are suppressed.
    on_disk
        Whether machine code is stored on disk. If not, no folder can be written to.
    """

    #: Number of kernels of W, F and K of linear tetrahedra, seconds to compile them (AMD EPYC), and seconds between messages.
    KERNELS, TIME, EVERY = 21, 8, 5.0

    def __init__(self) -> None:
        self.count, self.quiet, self.on_disk = 0, False, True
        self._began = self._said = 0.0

    def on_start(self, event: Any) -> None:
        if not self._began and _is_kernel(event):
            self._began = self._said = monotonic()
            stored = f"they are stored in {cache_folder()}; `skfem-stvk warm-up` compiles ahead, on all cores"
            self._say(
                f"compiling kernels for their first use: W, F and K of one kind of element have {self.KERNELS} kernels and take "
                f"about {self.TIME} s; {stored if self.on_disk else NOT_STORED}"
            )

    def on_end(self, event: Any) -> None:
        if _is_kernel(event):
            self.count += 1
            if monotonic() > self._said + self.EVERY:
                self._said = monotonic()
                self._say(f"{self.count} kernel{'s' * (self.count > 1)} compiled, {self._said - self._began:.0f} s after the first")

    def _say(self, text: str) -> None:
        log(text)
        if not self.quiet and launched()[0] == 0:  # one rank of several prints
            _print(text)


def _print(text: str) -> None:
    from ..terminal import note  # rich is imported only for a message

    note(text)


def _is_kernel(event: Any) -> bool:
    """Return whether the function that numba compiles is a kernel of this package, not an inlined piece."""
    dispatcher = event.data["dispatcher"]
    ours = dispatcher.py_func.__module__.startswith(__name__.partition(".")[0])
    return ours and not dispatcher.targetoptions.get("forceinline")


@contextmanager
def postpone_ctrl_c() -> Iterator[None]:
    """Postpone Ctrl-C to the end of the block.

    Callbacks of LLVM lose exceptions, and the process may end by a signal. Python handles signals in the main thread only; in other
    threads the block runs unchanged.
    """
    handler = signal.getsignal(signal.SIGINT)
    if handler is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    signals: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: signals.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if signals:
            signal.raise_signal(signal.SIGINT)


class _Lowering(Listener):
    """Listener that postpones Ctrl-C while LLVM compiles a function."""

    def __init__(self) -> None:
        self._waiting: list[AbstractContextManager[None]] = []

    def on_start(self, event: Any) -> None:
        if event.data["name"].startswith("native_lowering "):
            self._waiting.append(postpone_ctrl_c())
            self._waiting[-1].__enter__()

    def on_end(self, event: Any) -> None:
        if event.data["name"].startswith("native_lowering "):
            self._waiting.pop().__exit__(None, None, None)


first_use = FirstUse()


class _NoGarbageCollection(Listener):
    """Listener that disables Python's garbage collector while numba compiles.

    The collector took a sixth of the compile time, and found almost no garbage.
    """

    def __init__(self) -> None:
        self._depth, self._enabled = 0, True

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            self._enabled = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0 and self._enabled:
            gc.enable()


OPTIONS_OF_KERNELS: dict[str, Any] = {"fastmath": FASTMATH, "nogil": True, "error_model": "numpy"}


def kernel(function: Function) -> Function:
    """Compile at the first call for each type of arguments, store the machine code on disk, and release the GIL during calls.

    The key of the code on disk covers all files that the module of the kernel imports. The reason is that a kernel contains the
    code of the functions it calls. If no folder can be written to, every process compiles again.
    """
    compiled: Any = numba.njit(**OPTIONS_OF_KERNELS)(function)
    if compiled is not function:  # numba returns the function itself when it is switched off
        if cache_folder() is None:
            first_use.on_disk = False
        else:
            compiled._cache = KernelCache(function)
    kernel: Function = compiled
    return kernel


#: Options of pieces. Only kernels call pieces, and the machine code of a kernel contains its pieces. Therefore pieces have no
#: wrappers for Python and C, and no files. The first K of linear tetrahedra then takes a quarter less time to compile.
OPTIONS_OF_PIECES: Any = OPTIONS_OF_KERNELS | {
    "forceinline": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


class Piece(CPUDispatcher):
    """Function that only kernels can call. It has no Python wrapper, and numba would end the process if Python called it."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        name = self.py_func.__name__
        raise TypeError(
            f"{name} is inlined into kernels, so Python cannot call it. Call a kernel that contains it, or {name}.py_func."
        )


def inlined(function: Function, **more: Any) -> Function:
    """Compile a piece of the innermost loop of a kernel.

    Pieces are inlined, because a loop with a call in it is not vectorised. Python cannot call a piece (`Piece`).
    """
    compiled: Any = numba.njit(**OPTIONS_OF_PIECES | more)(function)
    if compiled is not function:
        compiled.__class__ = Piece
    piece: Function = compiled
    return piece


def by_type(stub: Callable[..., Any], kind: type, formulas: dict[tuple[str, type], Any]) -> Callable[[Function], Function]:
    """Return a decorator that registers the formula of `stub` for a first argument of type `kind`, a NamedTuple or None.

    Kernels call `stub(first, ...)`, and numba compiles the formula for the type of `first`. Python finds the formula in `formulas`.
    """

    def registered(formula: Function) -> Function:
        formulas[stub.__name__, kind] = formula

        def chosen(first: Any, *others: Any) -> Any:
            found = type(None) if isinstance(first, NoneType) else getattr(first, "instance_class", None)
            return formula if found is kind else None

        overload(stub, jit_options=OPTIONS_OF_PIECES, strict=False)(chosen)
        return formula

    return registered


# Machine code that returns arrays calls this function for their type each time. Ctrl-C takes effect inside Python functions, and
# machine code loses the exception, which gives a SystemError. Cached results need no Python function.
serialize._numba_unpickle = cache(serialize._numba_unpickle)
register("numba:compile", first_use)
register("numba:compile", _NoGarbageCollection())
register("numba:run_pass", _Lowering())


@cache
def source_hash(name: str) -> str:
    """Return the hash of the source of the kernel file `name` and of all files that it imports.

    Numba compares the hash to decide whether code on disk is current. The hash of numba itself covers only the file of the caller.
    Files with formulas chosen by type (`by_type`) are always included, because a kernel may use any of them.
    """
    texts = {file.stem: file.read_text(encoding="utf-8") for file in Path(__file__).parent.glob("*.py")}
    found, new = set(), {name, "compiled", *(stem for stem, text in texts.items() if "@by_type(" in text)}
    while new:
        found |= new
        imported = {other for stem in new for other in re.findall(r"^from \.(\w+) import", texts.get(stem, ""), re.MULTILINE)}
        new = imported - found
    return sha256("".join(texts.get(stem, "") for stem in sorted(found)).encode()).hexdigest()


class AlteredCode(Exception):
    """Error raised when a cache file differs from the file that was written."""


@cache
def cache_folder() -> Path | None:
    """Return the folder for the machine code of this installation, which is made; None if no folder is writable.

    The folder is in `NUMBA_CACHE_DIR` or else in the user's cache folder. Its name has the versions of package, Python and numba.
    It has a hash of the package's folder, too, so that checkouts do not replace the files of each other.
    """
    found = versions(("skfem-stvk", "numba"))
    package = sha256(str(Path(__file__).parents[1]).encode()).hexdigest()[:12]
    name = f"{found['skfem-stvk']}-python{found['python']}-numba{found['numba']}-{package}".replace(" ", "-")
    given, user = numba.config.CACHE_DIR, user_cache_path("skfem-stvk", appauthor=False)  # type: ignore[attr-defined]
    roots = [Path(given) / "skfem-stvk"] if given else []
    roots += [user] if user.is_absolute() else []  # it begins with "~" if there is no home
    for root in roots:
        with suppress(OSError):
            folder = root.absolute() / name
            folder.mkdir(parents=True, exist_ok=True)
            TemporaryFile(dir=folder).close()
            return folder
    return None


class CheckedFile(IndexDataCacheFile):
    """Cache files of one function. Each ends with its digest, because altered machine code would crash the process."""

    def save(self, key: Any, data: Any) -> None:
        """Save machine code with the source and the types that it belongs to, because processes may choose one name at once."""
        super().save(key, (self._source_stamp, key, data))

    def load(self, key: Any) -> Any:
        """Return the machine code for a key; None if there is none of this source and these types."""
        stamp, types, data = super().load(key) or (None, None, None)
        return data if (stamp, types) == (self._source_stamp, key) else None

    def _dump(self, value: Any) -> bytes:
        data: bytes = super()._dump(value)
        return data + sha256(data).digest()

    def _load_data(self, name: str) -> Any:
        stored = Path(self._data_path(name)).read_bytes()
        data, digest = stored[:-LENGTH], stored[-LENGTH:]
        if sha256(data).digest() != digest:
            raise AlteredCode(f"the content of {name} does not match its digest")
        return pickle.loads(data)

    def delete(self) -> None:
        """Delete the files of the function."""
        folder = Path(self._cache_path)
        with suppress(OSError):
            for file in [
                Path(self._index_path),
                *folder.glob(self._data_name_pattern.format(number=0).replace(".0.nbc", ".*.nbc")),
            ]:
                file.unlink(missing_ok=True)


class KernelFiles(CompileResultCacheImpl, _CacheLocator):
    """Files of a kernel: their folder, their names, and the source to which they belong."""

    def __init__(self, function: Any) -> None:
        self._lineno, self._py_file = function.__code__.co_firstlineno, function.__code__.co_filename
        self._module, self._locator = function.__module__.rpartition(".")[2], self
        self._filename_base = self.get_filename_base(f"{self._module}.{function.__qualname__}", getattr(sys, "abiflags", ""))

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(cache_folder())

    def get_source_stamp(self) -> str:
        """Return the hash of the source."""
        return source_hash(self._module)

    def get_disambiguator(self) -> str:
        """Return a text that distinguishes functions of one name in a file."""
        return str(self._lineno)


class KernelCache(FunctionCache):
    """Machine code of a kernel on disk. Damaged files and full disks only cost the time to compile it again."""

    _impl_class = KernelFiles

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file.__class__ = CheckedFile

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the machine code for the types of arguments; None if there is none."""
        try:
            with postpone_ctrl_c():
                return super().load_overload(signature, target)
        except Exception as error:  # pickle and LLVM raise many types of errors for damaged bytes
            self._cache_file.delete()
            _say(
                "damaged",
                f"a file of the kernel cache in {self.cache_path} is damaged ({_reason(error)}); it is deleted and compiled again",
            )
            return None

    def save_overload(self, signature: Any, data: Any) -> None:
        """Store the machine code for the types of arguments."""
        try:
            super().save_overload(signature, data)
        except OSError as error:
            _say(
                "full",
                f"compiled kernels cannot be stored in {self.cache_path} ({_reason(error)}), so every process compiles again. "
                "Free disk space, or set NUMBA_CACHE_DIR to another folder",
            )


def _say(kind: str, text: str) -> None:
    """Print a message of each kind once per process, because up to a hundred files may cause it."""
    if kind not in _reported:
        _reported.add(kind)
        log(text)
        _print(f"{text}.")


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
