"""Mutants: small faults in the functions of the package, drawn with a seed, six in each room."""

from __future__ import annotations

import ast
import re
from bisect import bisect
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

SEED = 21
PACKAGE = "skfem_stvk"
KINDS = ("constant", "index", "line", "operator", "sign", "swap")
#: Operators and what replaces them. `<` becomes `>=`, because `<=` often has the same effect on numbers with rounding errors.
OPERATORS = {
    ast.Add: "+-", ast.Sub: "-+", ast.Mult: "*/", ast.Div: "/*", ast.BitAnd: "&|", ast.BitOr: "|&", ast.Lt: ("<", ">="),
    ast.LtE: ("<=", ">"), ast.Gt: (">", "<="), ast.GtE: (">=", "<"), ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="),
    ast.And: ("and", "or"), ast.Or: ("or", "and"),
}  # fmt: skip
#: Functions whose arguments are messages, and functions that print: their mutants change no number.
MESSAGES = {"log", "warn", "print", "note", "_say", "_print", "add_argument", "__repr__", "__str__", "_repr_html_"}
#: Functions with symmetric arguments, or with a type as an argument, so that swapped arguments are the same or always an error.
SYMMETRIC = {"max", "min", "maximum", "minimum", "allclose", "isclose", "array_equal", "isinstance", "issubclass", "cast"}
#: Packages that the tests do without: no test of theirs would run a fault in the files that import them.
ABSENT = re.compile(rb"^\s*(import|from) (dolfinx|ngsolve|petsc4py|ufl)\b", re.MULTILINE)
PROBE = "__import__('protection_plugin').hit({!r})"


@dataclass(frozen=True)
class Mutant:
    """A fault: bytes `start` to `end` of `file` become `text`. The mutated expression or statement is the bytes `node`."""

    room: str
    kind: str
    file: str
    function: str
    start: int
    end: int
    text: str
    node: tuple[int, int]
    line: int

    @property
    def name(self) -> str:
        """Name, unique because a room has one mutant of each kind."""
        return f"{self.room}/{self.kind}"

    @property
    def compiled(self) -> bool:
        """Whether the fault may be in machine code, where Python sees no line."""
        return self.room == "kernels"

    def planted(self, source: bytes) -> bytes:
        """Return the source with the fault."""
        return source[: self.start] + self.text.encode() + source[self.end :]

    def lines(self, source: bytes) -> tuple[str, str]:
        """Return the line of the fault, without indentation, before and after."""
        before, after = (text.splitlines()[self.line - 1].strip().decode() for text in (source, self.planted(source)))
        return before, after

    def probes(self) -> Iterator[tuple[int, str]]:
        """Yield insertions (byte, text) that report that the expression or statement runs."""
        probe = PROBE.format(self.name)
        if self.kind == "line":
            yield self.node[0], f"{probe}; "
        else:
            yield self.node[0], f"({probe}, "
            yield self.node[1], ")[1]"


class Finder(ast.NodeVisitor):
    """Candidates of one file. Only bodies of functions have any: not docstrings, types, defaults, messages and decorators."""

    def __init__(self, room: str, file: str, source: bytes) -> None:
        self.room, self.file, self.source, self.found = room, file, source, list[Mutant]()
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.names: list[str] = []
        self.inside = self.in_index = False
        self.visit(ast.parse(source))

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Return the first byte of a node and the byte behind it."""
        begin, end = self.starts[node.lineno - 1], self.starts[node.end_lineno - 1]  # type: ignore[attr-defined]
        return begin + node.col_offset, end + node.end_col_offset  # type: ignore[attr-defined]

    def text(self, node: ast.AST) -> str:
        start, end = self.span(node)
        return self.source[start:end].decode()

    def add(self, kind: str, node: ast.AST, start: int, end: int, text: str) -> None:
        if self.inside:
            line = bisect(self.starts, start)
            function = ".".join(self.names)
            self.found.append(Mutant(self.room, kind, self.file, function, start, end, text, self.span(node), line))

    def between(self, node: ast.AST, left: ast.AST, right: ast.AST, operator: ast.AST) -> None:
        """Add the mutant that changes the operator between two operands."""
        old, new = OPERATORS.get(type(operator), ("", ""))
        start, end = self.span(left)[1], self.span(right)[0]
        gap = self.source[start:end].decode()
        if old and gap.count(old) == 1:
            self.add("operator", node, start, end, gap.replace(old, new))

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._within(node.name, node.body, False)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if node.name not in MESSAGES:
            self._within(node.name, node.body, True)

    def _within(self, name: str, body: list[ast.stmt], inside: bool) -> None:
        before, self.inside = self.inside, inside
        self.names.append(name)
        for statement in body:
            self.visit(statement)
        self.names.pop()
        self.inside = before

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Leave out formatted strings, which are messages."""

    def visit_Raise(self, node: ast.Raise) -> None:
        if "NotImplemented" not in self.text(node):
            self.add("line", node, *self.span(node), "pass")

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call) and _called(node.value) not in MESSAGES:
            self.add("line", node, *self.span(node), "pass")
        self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        if all(isinstance(target, ast.Attribute | ast.Subscript) for target in node.targets):
            self.add("line", node, *self.span(node), "pass")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self.add("line", node, *self.span(node), "pass")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name, first = _called(node), node.args[:2]
        if name in MESSAGES:
            return
        if name not in SYMMETRIC and len(first) == 2 and not any(isinstance(one, ast.Starred) for one in first):
            a, b = first
            gap = self.source[self.span(a)[1] : self.span(b)[0]].decode()
            if self.text(a) != self.text(b):
                self.add("swap", node, self.span(a)[0], self.span(b)[1], self.text(b) + gap + self.text(a))
        self.generic_visit(node)

    def visit_keyword(self, node: ast.keyword) -> None:
        if "tol" not in (node.arg or ""):  # a test that tells two tolerances apart would assert the number of iterations
            self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        strings = (ast.JoinedStr, ast.List, ast.Tuple)
        if not any(isinstance(one, strings) or _is_text(one) for one in (node.left, node.right)):
            self.between(node, node.left, node.right, node.op)
            if isinstance(node.op, ast.Mult) and not self.in_index:
                start, _ = self.span(node)
                self.add("sign", node, start, start, "-")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub) and not self.in_index:
            start, _ = self.span(node)
            self.add("sign", node, start, start + 1, "")
        if self.in_index or not isinstance(node.operand, ast.Constant):  # -2 for -1 is an error of `reshape`
            self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        if len(node.ops) == 1:
            self.between(node, node.left, node.comparators[0], node.ops[0])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        self.between(node, node.values[0], node.values[1], node.op)
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        before, self.in_index = self.in_index, True
        self.visit(node.slice)
        self.in_index = before

    def visit_Constant(self, node: ast.Constant) -> None:
        """Change small numbers only: large and tiny ones are sizes of blocks, limits and tolerances."""
        value, kind = node.value, "index" if self.in_index else "constant"
        if isinstance(value, bool):
            self.add(kind, node, *self.span(node), str(not value))
        elif isinstance(value, int) and value <= 16:
            self.add(kind, node, *self.span(node), str(value - 1 if value and self.in_index else value + 1))
        elif isinstance(value, float) and (value == 0 or 1e-3 <= value <= 1e3):
            self.add(kind, node, *self.span(node), str(2 * value if value else 1.0))


def _called(node: ast.Call) -> str:
    """Return the last name of the called function."""
    function = node.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def rooms(root: Path) -> dict[str, list[Path]]:
    """Return the files of each room of the package in the checkout `root`. The files on top of the package count as one room."""
    found: dict[str, list[Path]] = defaultdict(list)
    for path in sorted((root / PACKAGE).rglob("*.py")):
        parts = path.relative_to(root / PACKAGE).parts
        found[parts[0] if len(parts) > 1 else "files"].append(path)
    return found


def drawn(root: Path, seed: int = SEED) -> list[Mutant]:
    """Return one mutant of each kind for each room, in different functions.

    A candidate's number in the lottery is a hash of the seed, its function and its line, and the smallest number wins. A change of
    other functions therefore seldom changes the draw, and a move of files within a room does not.
    """
    chosen: list[Mutant] = []
    for room, paths in rooms(root).items():
        candidates, sources = defaultdict(list), {path: path.read_bytes() for path in paths}
        for path, source in sources.items():
            lines, seen = source.splitlines(), Counter[tuple[object, ...]]()
            for one in () if ABSENT.search(source) else Finder(room, path.relative_to(root).as_posix(), source).found:
                identity = (one.kind, one.function, lines[one.line - 1].strip(), one.text)
                candidates[one.kind].append((sha256(repr((seed, *identity, seen[identity])).encode()).digest(), one))
                seen[identity] += 1
        functions: set[tuple[str, str]] = set()
        for kind in KINDS:
            for _, one in sorted(candidates[kind], key=lambda entry: entry[0]):
                if (one.file, one.function) not in functions and _is_python(one.planted(sources[root / one.file])):
                    functions.add((one.file, one.function))
                    chosen.append(one)
                    break
    return chosen


def _is_python(source: bytes) -> bool:
    try:
        return bool(ast.parse(source))
    except SyntaxError:
        return False


def kernels_with(mutant: Mutant, root: Path) -> set[str]:
    """Return names of functions in `kernels` that contain the mutated function or use it, directly or through others.

    Uses are found by name. A formula that is registered for a type (`by_type`) is used by each function that uses its stub.
    """
    users: dict[str, set[str]] = defaultdict(set)
    for path in (root / PACKAGE / "kernels").glob("*.py"):
        for node in ast.parse(path.read_bytes()).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                for part in ast.walk(node):
                    users[_last(part)].add(node.name)
                for decorator in node.decorator_list:
                    if isinstance(decorator, ast.Call) and decorator.args:
                        users[node.name].add(_last(decorator.args[0]))
    found, new = set(), {mutant.function.partition(".")[0]}
    while new:
        found |= new
        new = set().union(*(users[name] for name in new)) - found
    return found


def _last(node: ast.AST) -> str:
    return getattr(node, "attr", getattr(node, "id", ""))
