"""The command `skfem-stvk` with wrong arguments, hostile file names, environments and streams: never a traceback."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import skfem

from skfem_stvk import StvkError

from .case import CONTROL, Case, Verdict, Wrong

COMMAND = (sys.executable, "-c", "import sys; from skfem_stvk.scenes.commands.__main__ import main; sys.exit(main())")
VERIFY = ("verify", "body.msh", "--young", "1e5", "--poisson", "0.3")
LONG, NOWHERE = "x" * 300, "/proc/nothing"

#: Arguments that must be refused.
ARGUMENTS: dict[str, tuple[str, ...]] = {
    "no command": (),
    "unknown command": ("verfiy",),
    "control characters": ("\x1b[31m",),
    "unknown option": (*VERIFY, "--colour"),
    "no material": ("verify", "body.msh"),
    "young alone": ("verify", "body.msh", "--young", "1e5"),
    "two meshes": ("verify", "body.msh", *VERIFY[1:]),
    "info with an argument": ("info", "more"),
    "export without --out": ("export", *VERIFY[1:]),
    "export to a file": ("export", *VERIFY[1:], "--out", "body.msh"),
    "--results and a mesh": (*VERIFY, "--results", "."),
    "--python alone": (*VERIFY, "--python", sys.executable),
    "a sweep of 1e9 runs": (
        *("sweep", "scene.toml", "--out", "out"),
        *(
            word
            for key in ("analysis.steps", "threads", "seed")
            for word in ("--set", f"{key}={','.join(map(str, range(1, 1001)))}")
        ),
    ),
    **{f"mesh {name[:20]!r}": ("verify", name, *VERIFY[2:]) for name in ("nothing.msh", ".", "", f"{LONG}.msh", "/dev/zero")},
    **{
        f"--young {young}": (*VERIFY[:2], f"--young={young}", "--poisson=0.3")
        for young in ("a", "nan", "inf", "-1", "0", "1j", "1e400")
    },
    **{f"--poisson {nu}": (*VERIFY[:2], "--young=1e5", f"--poisson={nu}") for nu in ("a", "nan", "0.5", "-1", "-inf")},
    **{f"--seed {seed}": (*VERIFY, f"--seed={seed}") for seed in ("-1", "a", "1e3", "")},
    **{f"--out {name[:20]!r}": (*VERIFY, "--out", name) for name in ("", "body.msh", "body.msh/below", LONG, NOWHERE)},
    **{f"--results {name[:20]!r}": ("verify", "--results", name) for name in ("", ".", "body.msh", LONG, "/dev/zero", "\x1b[31m")},
    **{
        f"--against {name[:20]!r}": (*VERIFY, "--against", name)
        for name in ("", "nobody", ":", "os:nothing", "os:_exit", "nothing.py:f", "/dev/zero:f", "\x1b[31m", LONG)
    },
    **{
        f"--python {name[:20]!r}": (*VERIFY, "--against", "felupe", "--python", name)
        for name in ("", "nothing", ".", "/dev/null", "body.msh", "/bin/true", "/bin/cat", LONG)
    },
}
#: Names of mesh files, which must not change the outcome.
NAMES = (
    *("\x1b[31mred.msh", "new\nline.msh", "[x]y[bold red].msh", "<script>alert(1)<.msh", "%s%n.msh", "{{7*7}}.msh", "$HOME.msh"),
    *("ü ñ 漢 😀.msh", "\udcff\udcfe.msh", "\u202egnp.msh", "y" * 240 + ".msh", "-.msh"),
)
#: Environments, in which the command works or is refused.
SURROUNDINGS: dict[str, dict[str, str | None]] = {
    **{f"MPLBACKEND={name}": {"MPLBACKEND": name} for name in ("nonsense", "module://nothing", "")},
    "HOME that is not there": {"HOME": NOWHERE, "XDG_CACHE_HOME": None, "MPLCONFIGDIR": NOWHERE, "TMPDIR": NOWHERE},
    "HOME unset": {"HOME": None},
    **{f"TERM={name}": {"TERM": name} for name in ("dumb", "nonsense", "")},
    **{f"COLUMNS={width}": {"COLUMNS": width} for width in ("0", "-5", "abc", "100000")},
    "LANG=C": {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"},
    "PYTHONWARNINGS=error": {"PYTHONWARNINGS": "error"},
    "PATH empty": {"PATH": ""},
    **{f"NUMBA_NUM_THREADS={n}": {"NUMBA_NUM_THREADS": n} for n in ("0", "abc", "1.5", "100000")},
    **{f"{name}_NUM_THREADS=abc": {f"{name}_NUM_THREADS": "abc"} for name in ("OMP", "OPENBLAS")},
    "NUMBA_THREADING_LAYER=nonsense": {"NUMBA_THREADING_LAYER": "nonsense"},
    **{f"NUMBA_CACHE_DIR={name}": {"NUMBA_CACHE_DIR": name} for name in (NOWHERE, "body.msh", "/dev/full")},
}


def _closed(*descriptors: int) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


def _broken_pipe() -> int:
    reading, writing = os.pipe()
    os.close(reading)
    return writing


def _in_deleted_folder() -> None:
    os.mkdir("gone")
    shutil.copy("body.msh", "gone")
    os.chdir("gone")
    shutil.rmtree(os.getcwd())


#: Streams and folders that fail.
STREAMS: dict[str, Callable[[], dict[str, Any]]] = {
    "standard input closed": lambda: {"preexec_fn": partial(_closed, 0)},
    "standard output closed": lambda: {"preexec_fn": partial(_closed, 1)},
    "all streams closed": lambda: {"preexec_fn": partial(_closed, 0, 1, 2)},
    "standard output full": lambda: {"stdout": os.open("/dev/full", os.O_WRONLY)},
    "standard error full": lambda: {"stderr": os.open("/dev/full", os.O_WRONLY)},
    "a broken pipe": lambda: {"stdout": _broken_pipe()},
    "a deleted folder": lambda: {"preexec_fn": _in_deleted_folder},
}


class Refused(StvkError):
    """Message of a command that ended with the exit code for bad input."""


def cases() -> Iterator[Case]:
    """Yield all commands."""

    def case(name: str, quick: bool = False, **given: Any) -> Case:
        return Case(name, partial(ran, **given), lambda done: None, seconds=120, gigabytes=4, quick=quick)

    for name, arguments in ARGUMENTS.items():
        yield case(f"arguments: {name}", arguments=arguments, refused=True, quick=name == "no command")
    for name, environment in SURROUNDINGS.items():
        yield case(f"verify with {name}", environment=environment)
    for name, streams in STREAMS.items():
        yield case(f"verify with {name}", streams=streams)
    for flag in ("-OO", "-Werror", "-I", "-bb", "-Xdev"):
        yield case(f"python {flag}", start=(COMMAND[0], flag, *COMMAND[1:]))
    for name in NAMES:
        yield Case(f"mesh named {name[:30]!r}", partial(named, name), lambda done: None, seconds=120, gigabytes=4)


def ran(
    folder: Path,
    arguments: Sequence[str | bytes] = VERIFY,
    environment: Mapping[str, str | None] | None = None,
    streams: Callable[[], dict[str, Any]] = dict,
    start: Sequence[str] = COMMAND,
    refused: bool = False,
) -> None:
    """Run a command to its end. It may succeed unless it must be refused, or end with exit code 2 and a message."""
    if not (folder / "body.msh").exists():
        skfem.MeshTet().save(folder / "body.msh")
    given = {name: value for name, value in (dict(os.environ) | dict(environment or {})).items() if value is not None}
    options: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL} | streams()
    done = subprocess.run([*start, *arguments], env=given, **options)
    out, err = ((stream or b"").decode(errors="backslashreplace") for stream in (done.stdout, done.stderr))
    if "Traceback (most recent call last)" in out + err or "Exception ignored" in out + err:
        raise Wrong(Verdict.TRACEBACK, (out + err)[-3000:])
    if done.returncode < 0:
        raise Wrong(Verdict.CRASH, f"ended by {signal.Signals(-done.returncode).name}: {(out + err)[-3000:]}")
    if CONTROL & set(out + err):
        raise Wrong(Verdict.SILENT, f"control characters on the terminal: {sorted(CONTROL & set(out + err))!r}")
    if done.returncode == 2:
        if len(err.split()) < 4 and "stderr" not in streams() and "preexec_fn" not in streams():
            raise Wrong(Verdict.TRACEBACK, f"exit code 2 without a message: {out + err!r}")
        raise Refused(err or "exit code 2, with a message to a closed stream")
    if refused or done.returncode not in (0, 1) or (done.returncode == 0 and out and "PASSED" not in out):
        raise Wrong(Verdict.SILENT, f"exit code {done.returncode}: {(out + err)[-3000:]}")


def named(name: str, folder: Path) -> None:
    """Verify the mesh under another file name. The report must pass."""
    skfem.MeshTet().save(folder / "body.msh")
    os.rename(folder / "body.msh", os.fsencode(folder / name))
    ran(folder, ["verify", os.fsencode(f"./{name}"), "--young=1e5", "--poisson=0.3", "--out", "report"])
    if not json.loads((folder / "report" / "report.json").read_text())["passed"]:
        raise Wrong(Verdict.SILENT, "the report did not pass")
