"""The command `skfem-stvk` with wrong arguments, hostile file names and environments, and interruptions: never a traceback."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skfem

import skfem_stvk
from skfem_stvk.errors import StvkError

from .case import Case, Verdict, Wrong
from .checkpoints import NOT_OURS

COMMAND = (sys.executable, "-m", "skfem_stvk.scenes.commands")
VERIFY = ("verify", "body.msh", "--young", "1e5", "--poisson", "0.3")
#: Program with one kernel, and the energy that it must print.
PROGRAM = """
import skfem
from skfem_stvk import StVK, System
mesh = skfem.MeshTet().refined(1)
print("W =", System(mesh, StVK(young=1e5, poisson=0.3)).energy(0.01 * mesh.p.ravel("F")))
"""
ENERGY = 4.5 * 1e5 / 1.2 * 0.01005**2
#: Environment variables of the worker that commands do not inherit.
UNSET = ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MPLBACKEND")
#: Control characters that must not appear in output that does not go to a terminal.
CONTROL = {chr(code) for code in (*range(32), 127, *range(128, 160))} - {"\n", "\r"}
REFUSED, WORKS, EITHER = "refused", "works", "either"


class Finished(NamedTuple):
    """Exit code and output of a process."""

    code: int
    out: str
    err: str


class Refused(StvkError):
    """Message of a command that ended with the exit code for bad input."""


def cases() -> Iterator[Case]:
    """Yield all commands."""
    for name, arguments in ARGUMENTS.items():
        yield command(f"arguments: {name}", arguments, REFUSED, quick=name == "no command")
    for name in NAMES:
        yield Case(f"mesh named {name[:30]!r}", partial(named, name), partial(right, worked="PASSED"), seconds=120, gigabytes=4)
    for name, given in SURROUNDINGS.items():
        yield command(f"verify with {name}", VERIFY, environment=given)
    for name, given in THREADS_AND_CACHES.items():
        yield command(f"kernel with {name}", (), environment=given, start=(sys.executable, "-c", PROGRAM))
    for what in ANSWERS:
        yield Case(f"--python answers with {what}", partial(answered, NOT_OURS[what]), seconds=120, gigabytes=4)
    for name, options in STREAMS.items():
        yield command(f"verify with {name}", VERIFY, EITHER, options=options, readable=False)
    for flag in ("-OO", "-Werror", "-I", "-bb", "-Xdev", "-Xutf8=0"):
        yield command(f"python {flag}", VERIFY, WORKS, start=(sys.executable, flag, "-m", "skfem_stvk.scenes.commands"))
    for name, change in OUTPUTS.items():
        yield Case(f"--out {name}", partial(written, change), partial(right, worked="PASSED"), seconds=120, gigabytes=4)
    for damage in DAMAGES:
        yield Case(f"kernel with {damage}", partial(damaged, damage), partial(right, worked=ENERGY_LINE), seconds=120, gigabytes=4)
    for seed in range(10):
        yield Case(f"Ctrl-C, seed {seed}", partial(interrupted, seed), lambda finished: None, seconds=120, gigabytes=4)


def command(
    name: str,
    arguments: Sequence[str],
    expected: str = EITHER,
    environment: Mapping[str, str | None] | None = None,
    start: Sequence[str] = COMMAND,
    options: Mapping[str, Any] | None = None,
    readable: bool = True,
    quick: bool = False,
) -> Case:
    """Return the case of a command that must be refused, must work, or may do either.

    `readable` says whether the case can read the output of the command.
    """

    def attempt(folder: Path) -> Finished:
        body(folder)
        made = {name: make() for name, make in (options or {}).items()}
        return checked(ran([*start, *arguments], environment or {}, **made), expected)

    judge = partial(right, worked=WORKED.get(tuple(start), "PASSED")) if readable else lambda finished: None
    return Case(name, attempt, judge, seconds=120, gigabytes=4, quick=quick)


def body(folder: Path) -> Path:
    """Write a small mesh file and return its path."""
    path = folder / "body.msh"
    skfem.MeshTet().save(path)
    return path


def ran(arguments: Sequence[str | bytes], environment: Mapping[str, str | None], **options: Any) -> Finished:
    """Run a process to its end. Variables that are None are removed from the environment."""
    given: dict[str, str | None] = dict(os.environ) | dict.fromkeys(UNSET) | dict(environment)
    streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL} | options
    process = subprocess.run(arguments, env={key: value for key, value in given.items() if value is not None}, **streams)
    out, err = ((stream or b"").decode(errors="backslashreplace") for stream in (process.stdout, process.stderr))
    return Finished(process.returncode, out, err)


def checked(finished: Finished, expected: str = EITHER) -> Finished:
    """Return the finished process if its end is legal.

    Raise `Refused` for a readable refusal, and `Wrong` for a traceback, a signal, control characters or an unexpected exit code.
    """
    output = finished.out + finished.err
    if "Traceback (most recent call last)" in output or "Exception ignored" in output:
        raise Wrong(Verdict.TRACEBACK, output[-3000:])
    if finished.code < 0:
        raise Wrong(Verdict.CRASH, f"ended by {signal.Signals(-finished.code).name}: {output[-3000:]}")
    control = sorted(CONTROL & set(output))
    if control:
        raise Wrong(Verdict.SILENT, f"control characters on the terminal: {control!r}")
    if finished.code == 2 and expected != WORKS:
        if len(finished.err.split()) < 4:
            raise Wrong(Verdict.TRACEBACK, f"exit code 2 without a message: {output!r}")
        raise Refused(finished.err)
    if expected == REFUSED or finished.code not in (0, 1):
        raise Wrong(Verdict.SILENT, f"exit code {finished.code}: {output[-3000:]}")
    return finished


def right(finished: Finished, worked: str) -> None:
    """Raise `Wrong` unless the command printed the expected energy, or passed and printed `worked`. Empty output is accepted."""
    if worked == ENERGY_LINE:
        value = float(finished.out.split("W =")[1]) if "W =" in finished.out else np.nan
        if not abs(value / ENERGY - 1) < 1e-12:
            raise Wrong(Verdict.SILENT, f"W = {value}; expected {ENERGY}: {finished}")
    elif finished.code != 0 or (finished.out and worked not in finished.out):
        raise Wrong(Verdict.SILENT, f"the command did not pass: {finished}")


ENERGY_LINE = "W ="
WORKED: dict[Sequence[str], str] = {(sys.executable, "-c", PROGRAM): ENERGY_LINE}

LONG = "x" * 300
ARGUMENTS: dict[str, tuple[str, ...]] = {
    "no command": (),
    "unknown command": ("verfiy",),
    "control characters": ("\x1b[31m",),
    "unknown option": (*VERIFY, "--colour"),
    "unknown mesh": ("verify", "nothing.msh", "--young", "1", "--poisson", "0.3"),
    "a folder as mesh": ("verify", ".", "--young", "1", "--poisson", "0.3"),
    "an empty mesh name": ("verify", "", "--young", "1", "--poisson", "0.3"),
    "a long mesh name": ("verify", f"{LONG}.msh", "--young", "1", "--poisson", "0.3"),
    "a device as mesh": ("verify", "/dev/zero", "--young", "1", "--poisson", "0.3"),
    "no material": ("verify", "body.msh"),
    "young alone": ("verify", "body.msh", "--young", "1e5"),
    "poisson alone": ("verify", "body.msh", "--poisson", "0.3"),
    **{
        f"--young {young}": ("verify", "body.msh", f"--young={young}", "--poisson=0.3")
        for young in ("a", "nan", "inf", "-1", "0", "")
    },
    **{
        f"--young {young}": ("verify", "body.msh", f"--young={young}", "--poisson=0.3")
        for young in ("1e400", "1e-400", "1e306", "1j")
    },
    **{
        f"--poisson {nu}": ("verify", "body.msh", "--young=1e5", f"--poisson={nu}")
        for nu in ("a", "nan", "0.5", "-1", "0.7", "-inf")
    },
    **{f"--seed {seed}": (*VERIFY, f"--seed={seed}") for seed in ("-1", "a", "1e3", "0.5", "")},
    "two meshes": ("verify", "body.msh", "body.msh", "--young", "1", "--poisson", "0.3"),
    "--out without a name": (*VERIFY, "--out"),
    "--out empty": (*VERIFY, "--out", ""),
    "--out is a file": (*VERIFY, "--out", "body.msh"),
    "--out below a file": (*VERIFY, "--out", "body.msh/below"),
    "--out with a long name": (*VERIFY, "--out", LONG),
    "--out where nothing can be made": (*VERIFY, "--out", "/proc/nothing"),
    "bench --quick 3": ("bench", "--quick", "3"),
    "info with an argument": ("info", "more"),
    "export without --out": ("export", "body.msh", "--young", "1", "--poisson", "0.3"),
    "export without a material": ("export", "body.msh", "--out", "vectors"),
    "export to a file": ("export", "body.msh", "--young", "1", "--poisson", "0.3", "--out", "body.msh"),
    "export of nothing": ("export", "nothing.msh", "--young", "1", "--poisson", "0.3", "--out", "vectors"),
    **{
        f"--results {name}": ("verify", "--results", name)
        for name in ("", ".", "body.msh", "nothing", LONG, "/dev/zero", "\x1b[31m")
    },
    "--results and a mesh": (*VERIFY, "--results", "."),
    "--vectors alone": (*VERIFY, "--vectors", "."),
    **{
        f"--against {name}": (*VERIFY, "--against", name)
        for name in (
            "",
            "nobody",
            ":",
            "::",
            "os:nothing",
            "os:_exit",
            "nothing.py:f",
            "/dev/zero:f",
            "\x1b[31m",
            LONG,
            "mujoco:a:b",
        )
    },
    **{
        f"--python {name}": (*VERIFY, "--against", "felupe", "--python", name)
        for name in ("", "nothing", ".", "/dev/null", "body.msh", "/bin/true", "/bin/cat", LONG)
    },
    "--python alone": (*VERIFY, "--python", sys.executable),
}
ANSWERS = ("empty", "text", "a pickle", "an .npz file of pickles", "an .npz file of others", "an .npy file", "a bomb of zeros")


def answered(make: Callable[[Path], object], folder: Path) -> Finished:
    """Run `verify` against a peer whose program answers the first request with this file."""
    body(folder)
    answer, program = folder / "answer.npz", folder / "program"
    answer.touch()
    make(answer)
    (folder / "length").write_bytes(answer.stat().st_size.to_bytes(8, "big"))
    program.write_text("#!/bin/sh\ncat length answer.npz; cat > /dev/null\n")
    program.chmod(0o755)
    return checked(ran([*COMMAND, *VERIFY, "--against", "felupe", "--python", "./program"], {}), REFUSED)


NAMES = (
    "\x1b[31mred.msh",
    "new\nline.msh",
    "bell\x07.msh",
    "[bold]x.msh",
    "[x]y[bold red].msh",
    "<script>alert(1)<.msh",
    "%s%n.msh",
    "{{7*7}}.msh",
    "$HOME.msh",
    "ü ñ 漢 😀.msh",
    "\udcff\udcfe.msh",
    "\u202egnp.msh",
    "y" * 240 + ".msh",
    "-.msh",
)


def named(name: str, folder: Path) -> Finished:
    """Verify the mesh under another file name."""
    os.rename(body(folder), os.fsencode(folder / name))
    finished = checked(ran([*COMMAND, "verify", os.fsencode(f"./{name}"), "--young=1e5", "--poisson=0.3", "--out", "report"], {}))
    report = json.loads((folder / "report" / "report.json").read_text())
    if not report["passed"]:
        raise Wrong(Verdict.SILENT, "the report did not pass")
    return finished


NOWHERE = "/proc/nothing"
SURROUNDINGS: dict[str, dict[str, str | None]] = {
    **{f"MPLBACKEND={name}": {"MPLBACKEND": name} for name in ("nonsense", "TkAgg", "module://nothing", "")},
    "MPLCONFIGDIR that cannot be made": {"MPLCONFIGDIR": NOWHERE},
    "HOME that is not there": {"HOME": NOWHERE, "XDG_CACHE_HOME": None},
    "HOME unset": {"HOME": None},
    "TMPDIR that is not there": {"TMPDIR": NOWHERE},
    **{f"TERM={name}": {"TERM": name} for name in ("dumb", "nonsense", "")},
    **{f"COLUMNS={width}": {"COLUMNS": width} for width in ("0", "1", "-5", "abc", "100000")},
    "LANG=C": {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "PYTHONIOENCODING=ascii": {"PYTHONIOENCODING": "ascii"},
    "PYTHONWARNINGS=error": {"PYTHONWARNINGS": "error"},
    "NO_COLOR": {"NO_COLOR": "1", "TERM": "xterm-256color"},
    "PATH empty": {"PATH": ""},
}
THREADS_AND_CACHES: dict[str, dict[str, str | None]] = {
    **{f"NUMBA_NUM_THREADS={n}": {"NUMBA_NUM_THREADS": n} for n in ("0", "-1", "abc", "1.5", "", "100000")},
    **{f"NUMBA_THREADING_LAYER={n}": {"NUMBA_THREADING_LAYER": n} for n in ("nonsense", "tbb", "")},
    **{f"OMP_NUM_THREADS={n}": {"OMP_NUM_THREADS": n} for n in ("0", "abc", "-3")},
    **{f"OPENBLAS_NUM_THREADS={n}": {"OPENBLAS_NUM_THREADS": n} for n in ("0", "abc", "-3")},
    "NUMBA_CACHE_DIR that cannot be made": {"NUMBA_CACHE_DIR": NOWHERE},
    "NUMBA_CACHE_DIR that is a file": {"NUMBA_CACHE_DIR": "body.msh"},
    "NUMBA_CACHE_DIR on a full disk": {"NUMBA_CACHE_DIR": "/dev/full"},
    "NUMBA_DISABLE_JIT=1": {"NUMBA_DISABLE_JIT": "1"},
    "NUMBA_CPU_NAME=generic": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
}


def _limited(which: int, value: int) -> Callable[[], None]:
    def limit() -> None:
        resource.setrlimit(which, (value, value))

    return limit


def _closed(*descriptors: int) -> Callable[[], None]:
    def close() -> None:
        for descriptor in descriptors:
            os.close(descriptor)

    return close


def _broken_pipe() -> int:
    reading, writing = os.pipe()
    os.close(reading)
    return writing


def _in_deleted_folder() -> Callable[[], None]:
    def leave() -> None:
        os.mkdir("gone")
        shutil.copy("body.msh", "gone")
        os.chdir("gone")
        shutil.rmtree(os.getcwd())

    return leave


STREAMS: dict[str, dict[str, Callable[[], Any]]] = {
    "standard input closed": {"preexec_fn": lambda: _closed(0)},
    "standard output closed": {"preexec_fn": lambda: _closed(1)},
    "standard error closed": {"preexec_fn": lambda: _closed(2)},
    "all streams closed": {"preexec_fn": lambda: _closed(0, 1, 2)},
    "standard output full": {"stdout": lambda: os.open("/dev/full", os.O_WRONLY)},
    "standard error full": {"stderr": lambda: os.open("/dev/full", os.O_WRONLY)},
    "a pipe that nobody reads": {"stdout": _broken_pipe},
    "16 open files at most": {"preexec_fn": lambda: _limited(resource.RLIMIT_NOFILE, 16)},
    "no new processes": {"preexec_fn": lambda: _limited(resource.RLIMIT_NPROC, 0)},
    "a working folder that is gone": {"preexec_fn": _in_deleted_folder},
}


def _nothing(folder: Path) -> dict[str, Any]:
    return {}


def _full(size: int, folder: Path) -> dict[str, Any]:
    """Limit the size of files, as on a full disk."""
    return {"preexec_fn": _limited(resource.RLIMIT_FSIZE, size)}


def _folder_named(name: str, folder: Path) -> dict[str, Any]:
    """Create a folder with the name of a file of the report."""
    (folder / "report" / name).mkdir(parents=True)
    return {}


def _link(folder: Path) -> dict[str, Any]:
    (folder / "report").symlink_to("nowhere/at/all")
    return {}


OUTPUTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "new": _nothing,
    **{f"on a disk that is full after {size} bytes": partial(_full, size) for size in (0, 100, 5_000, 60_000)},
    "with a folder named report.json": partial(_folder_named, "report.json"),
    "with a folder named report.html": partial(_folder_named, "report.html"),
    "a link to nowhere": _link,
}


def written(change: Callable[[Path], dict[str, Any]], folder: Path) -> Finished:
    """Run `verify --out`: it must write complete reports, or none and a readable message."""
    body(folder)
    finished = ran([*COMMAND, *VERIFY, "--out", "report"], {"NUMBA_CACHE_DIR": None}, **change(folder))
    refuse_truncated_reports(folder, finished.err)
    return checked(finished)


def refuse_truncated_reports(folder: Path, output: str) -> None:
    """Raise `Wrong` if a file of the report is truncated; a missing file is legal."""
    for path in (folder / "report" / "report.json", folder / "report" / "report.html"):
        if path.is_file():
            text = path.read_text()
            whole = text.rstrip().endswith("</html>") if path.suffix == ".html" else text.rstrip().endswith("}")
            if not whole:
                raise Wrong(Verdict.LOSS, f"{path.name} is truncated to {len(text)} characters: {output}")


def _each(change: Callable[[Path], object], ending: str) -> Callable[[Path], None]:
    def damage(cache: Path) -> None:
        for path in sorted(cache.glob(f"*{ending}")):
            change(path)

    return damage


def _as_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _as_file(cache: Path) -> None:
    shutil.rmtree(cache)
    cache.write_text("no folder")


DAMAGES: dict[str, Callable[[Path], None]] = {
    "an empty index of numba's cache": _each(lambda path: path.write_bytes(b""), ".nbi"),
    "a cut index of numba's cache": _each(lambda path: path.write_bytes(path.read_bytes()[:60]), ".nbi"),
    "a random index of numba's cache": _each(lambda path: path.write_bytes(np.random.default_rng(6).bytes(500)), ".nbi"),
    "empty code in numba's cache": _each(lambda path: path.write_bytes(b""), ".nbc"),
    "cut code in numba's cache": _each(lambda path: path.write_bytes(path.read_bytes()[:1000]), ".nbc"),
    "random code in numba's cache": _each(lambda path: path.write_bytes(np.random.default_rng(6).bytes(5000)), ".nbc"),
    "folders in numba's cache": _each(_as_folder, ".nbc"),
    "numba's cache as a file": _as_file,
}


def damaged(damage: str, folder: Path) -> Finished:
    """Run a kernel in a copy of the package whose compiled code on disk is damaged."""
    package = Path(skfem_stvk.__file__).parent
    shutil.copytree(package, folder / "skfem_stvk")
    program, places = [sys.executable, "-c", PROGRAM], {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    checked(ran(program, places), WORKS)
    (cache,) = (folder / "cache" / "skfem-stvk").iterdir()
    DAMAGES[damage](cache)
    return checked(ran(program, places), WORKS)


def interrupted(seed: int, folder: Path) -> Finished:
    """Press Ctrl-C at a random time after the start of the command, during imports or later."""
    body(folder)
    begin = "import sys; from skfem_stvk.scenes.commands.__main__ import main; print('begun', flush=True); sys.exit(main())"
    with subprocess.Popen(
        [sys.executable, "-c", begin, *VERIFY, "--out", "report"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # shells ignore SIGINT in background processes
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(float(np.random.default_rng(seed).uniform(0, 3)))
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
    finished = Finished(process.returncode, out, err)
    if "Traceback" in out + err or (finished.code != 0 and "interrupted" not in out + err):
        raise Wrong(Verdict.TRACEBACK, f"exit code {finished.code}: {out + err}")
    refuse_truncated_reports(folder, err)
    return finished
