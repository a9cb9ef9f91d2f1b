"""Machine code on disk: what is damaged is deleted and compiled anew, what cannot be kept is compiled in every process; both are said."""

from __future__ import annotations

import pickle
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile
from rich.console import Console

LENGTH = sha256().digest_size


class Damaged(Exception):
    """A file of the cache does not hold what was written."""


class CheckedFile(IndexDataCacheFile):
    """Numba's files of one function, each with its digest at the end: machine code that was altered on disk would crash the process."""

    def _dump(self, value: Any) -> bytes:
        data: bytes = super()._dump(value)
        return data + sha256(data).digest()

    def _load_data(self, name: str) -> Any:
        stored = Path(self._data_path(name)).read_bytes()
        data, digest = stored[:-LENGTH], stored[-LENGTH:]
        if sha256(data).digest() != digest:
            raise Damaged(f"{name} does not hold what was written")
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


def keep_with_care(dispatcher: Any) -> None:
    """Have a compiled function's cache survive files that are damaged, and disks that are full."""
    cache = dispatcher._cache
    cache._cache_file.__class__ = CheckedFile
    load, save = cache.load_overload, cache.save_overload

    def loaded(signature: Any, target: Any) -> Any:
        try:
            return load(signature, target)
        except Exception as error:  # whatever pickle and LLVM make of damaged bytes
            cache._cache_file.delete()
            _say(
                "damaged",
                f"a file of the cache in {cache.cache_path} is damaged ({_reason(error)}); it is deleted and compiled anew",
            )
            return None

    def saved(signature: Any, data: Any) -> None:
        try:
            save(signature, data)
        except OSError as error:
            _say(
                "full",
                f"compiled kernels cannot be kept in {cache.cache_path} ({_reason(error)}): every process compiles. "
                "Make room, or set NUMBA_CACHE_DIR to another folder",
            )

    cache.load_overload, cache.save_overload = loaded, saved


_said: set[str] = set()


def _say(kind: str, text: str) -> None:
    """Once a process, as there may be a hundred such files."""
    if kind not in _said:
        _said.add(kind)
        Console(stderr=True, highlight=False).print(f"skfem_stvk: {text}.", style="dim", markup=False, soft_wrap=True)


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
