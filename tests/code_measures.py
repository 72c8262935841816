"""Measures of the code and the bars they are held to: how it is divided, how long, typed and documented.

    python -m tests.code_measures [--places]

prints a table, a column for each package; ``--places`` lists where a measure is missed too. Only the text is read.
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib.util import resolve_name
from pathlib import Path
from statistics import median
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGES = ("macrofit", "meso", "surrogate")
FLAT = {"macrofit": 16, "meso": 16, "surrogate": 8}  # files at the top of a package
MEDIAN = 9  # lines of a function
LONG_FUNCTION = 60  # lines, from `def` to the end
LONG_MODULE = 500  # lines
SHORT_DOCSTRING = 14  # characters
WIDE_RECORD = 5  # fields
RECORDS = {"Struct", "NamedTuple"}
KERNELS = {"njit", "jit", "vectorize", "guvectorize", "stencil", "cfunc", "intrinsic", "overload"}

MEASURES = (
    "files flat at the top",
    f"modules over {LONG_MODULE} lines, those of kernels excepted",
    "median function [lines]",
    f"functions over {LONG_FUNCTION} lines, kernels excepted",
    "functions fully annotated, kernels excepted",
    "public modules, classes and functions documented",
    f'docstrings that begin with "Of" or are under {SHORT_DOCSTRING} letters',
    f"records of {WIDE_RECORD} fields and more made by position",
    "import circles of modules",
    "import circles of rooms",
)

Result = tuple[tuple[str, ...], str, tuple[str, ...], bool]  # a Measure but for its name
Function = ast.FunctionDef | ast.AsyncFunctionDef


class Module(NamedTuple):
    """A file of a package, parsed."""

    name: str  # dotted
    path: Path
    text: str
    tree: ast.Module

    @property
    def package(self) -> str:
        """What its relative imports start from."""
        return self.name if self.path.name == "__init__.py" else self.name.rpartition(".")[0]


class Measure(NamedTuple):
    """One row: values of all packages, whether they are good enough, and where not."""

    what: str
    values: tuple[str, ...]
    bar: str
    places: tuple[str, ...]  # what misses the bar, or lowers the share
    kept: bool


@dataclass(frozen=True)
class Package:
    """The modules of one package with everything that is counted in them."""

    name: str
    modules: tuple[Module, ...]
    root: Path = field(default=ROOT)

    @cached_property
    def functions(self) -> list[tuple[str, Function]]:
        """Every function and method with its place, those inside functions too."""
        return [(place(m, node), node) for m in self.modules for node in ast.walk(m.tree) if isinstance(node, Function)]

    @cached_property
    def classes(self) -> list[tuple[str, ast.ClassDef]]:
        """Every class with its place."""
        return [
            (place(m, node), node) for m in self.modules for node in ast.walk(m.tree) if isinstance(node, ast.ClassDef)
        ]

    def flat(self) -> list[str]:
        """Files at the top."""
        return sorted(m.path.name for m in self.modules if m.path.parent == self.root / self.name)

    def long_functions(self) -> list[str]:
        """Functions of more than sixty lines that are no kernels."""
        return [
            f"{where} has {length(node)} lines"
            for where, node in self.functions
            if length(node) > LONG_FUNCTION and not is_kernel(node)
        ]

    def without_types(self) -> list[str]:
        """Functions of which an argument or the result has no annotation; numba infers those of kernels."""
        return [where for where, node in self.typed_functions() if not is_annotated(node)]

    def typed_functions(self) -> list[tuple[str, Function]]:
        """Functions that are to be annotated."""
        return [(where, node) for where, node in self.functions if not is_kernel(node)]

    def without_words(self) -> list[str]:
        """Public modules, classes and functions without a docstring."""
        return [where for where, node in self.public() if not ast.get_docstring(node)]

    def public(self) -> list[tuple[str, ast.Module | ast.ClassDef | Function]]:
        """Modules, classes, functions and methods whose names, and those of what they are in, have no underscore."""
        return [pair for module in self.modules for pair in public_of(module)]

    def poor_docstrings(self) -> list[str]:
        """Docstrings, of attributes too, that begin with "Of" or are hardly a word."""
        return [
            f"{where} {text.splitlines()[0]!r}"
            for where, text in self.docstrings()
            if text.startswith("Of ") or len(text) < SHORT_DOCSTRING
        ]

    def docstrings(self) -> Iterator[tuple[str, str]]:
        """Docstrings of modules, classes and functions, and the strings under attributes."""
        for module in self.modules:
            for node in ast.walk(module.tree):
                if isinstance(node, ast.Module | ast.ClassDef | Function):
                    if text := ast.get_docstring(node):
                        yield place(module, node), text
                    yield from ((place(module, node, line), text) for line, text in attribute_docstrings(node))

    def long_modules(self) -> list[str]:
        """Files of more than 500 lines; kernels that call each other must share one, so that numba sees them."""
        sizes = [(m, len(m.text.splitlines())) for m in self.modules if not is_of_kernels(m)]
        return [f"{m.path.relative_to(self.root)} has {size} lines" for m, size in sizes if size > LONG_MODULE]

    def circles(self) -> list[str]:
        """Groups of modules that import each other, at the top or inside functions; not what only types need."""
        return [" <-> ".join(group) for group in circles(self.imports())]

    def room_circles(self) -> list[str]:
        """The same of the folders and files at the top."""
        rooms: dict[str, set[str]] = {}
        for source, targets in self.imports().items():
            rooms.setdefault(room(source), set()).update(room(target) for target in targets)
        return [" <-> ".join(group) for group in circles(rooms)]

    def imports(self) -> dict[str, set[str]]:
        """Of each module the modules of the package that it imports."""
        names = {module.name for module in self.modules}
        return {module.name: imported(module, names) - {module.name} for module in self.modules}


def place(module: Module, node: ast.AST, line: int | None = None) -> str:
    """File, line and name of a node."""
    name = getattr(node, "name", "")
    return f"{module.path.relative_to(module.path.parents[module.name.count('.') + is_init(module)])}" + (
        f":{line or getattr(node, 'lineno', 1)} {name}".rstrip()
    )


def is_init(module: Module) -> bool:
    """Whether a module is the front of a folder, which stands one level deeper than its name says."""
    return module.path.name == "__init__.py"


def length(node: Function) -> int:
    """Lines from `def` to the end."""
    return (node.end_lineno or node.lineno) - node.lineno + 1


def last_name(node: ast.expr) -> str:
    """`njit` of `@njit`, `@numba.njit` and `@njit(cache=True)`; `Struct` of `msgspec.Struct`."""
    if isinstance(node, ast.Call):
        return last_name(node.func)
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def is_kernel(node: Function) -> bool:
    """Whether numba compiles a function."""
    return any(last_name(decorator) in KERNELS for decorator in node.decorator_list)


def is_of_kernels(module: Module) -> bool:
    """Whether most functions of a module are kernels."""
    found = [is_kernel(node) for node in ast.walk(module.tree) if isinstance(node, Function)]
    return 2 * sum(found) > len(found)


def is_annotated(node: Function) -> bool:
    """Whether every argument, but self and cls, and the result have a type."""
    given = node.args
    arguments = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    if arguments and arguments[0].arg in ("self", "cls"):
        arguments = arguments[1:]
    return node.returns is not None and all(argument.annotation is not None for argument in arguments)


def public_of(module: Module) -> Iterator[tuple[str, ast.Module | ast.ClassDef | Function]]:
    """What of a module others may use."""
    parts = module.name.split(".")
    if any(part.startswith("_") and part != "__main__" for part in parts):
        return
    yield place(module, module.tree), module.tree
    waiting: list[ast.Module | ast.ClassDef] = [module.tree]
    while waiting:
        for node in waiting.pop().body:
            if isinstance(node, ast.ClassDef | Function) and not node.name.startswith("_") and not is_overload(node):
                yield place(module, node), node
                if isinstance(node, ast.ClassDef):
                    waiting.append(node)


def is_overload(node: ast.ClassDef | Function) -> bool:
    """Whether a function only gives types to another of its name, or its words stand in a base class."""
    return any(last_name(decorator) in ("overload", "override", "setter") for decorator in node.decorator_list)


def attribute_docstrings(node: ast.Module | ast.ClassDef | Function) -> Iterator[tuple[int, str]]:
    """Line and text of the strings that stand under assignments."""
    for before, after in zip(node.body, node.body[1:], strict=False):
        if isinstance(before, ast.Assign | ast.AnnAssign) and isinstance(after, ast.Expr):
            text = after.value.value if isinstance(after.value, ast.Constant) else None
            if isinstance(text, str):
                yield after.lineno, text.strip()


def imported(module: Module, names: set[str]) -> set[str]:
    """Which of ``names`` a module imports, unless for types alone."""
    found: set[str] = set()
    waiting: list[ast.AST] = [module.tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and last_name(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= set(imported_from(node, module.package, names))
        waiting += ast.iter_child_nodes(node)
    return found & names


def imported_from(node: ast.ImportFrom, package: str, names: set[str]) -> Iterator[str]:
    """`from a import b` needs the module a.b where there is one, else a."""
    source = resolve_name("." * node.level + (node.module or ""), package)
    for alias in node.names:
        below = f"{source}.{alias.name}"
        yield below if below in names else source


def room(name: str) -> str:
    """The folder or file at the top that a module is in."""
    return ".".join(name.split(".")[:2])


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """The groups of more than one node that all reach each other."""
    reach = {node: reachable(graph, node) for node in graph}
    groups = {frozenset(other for other in reach[node] if node in reach.get(other, ())) for node in graph}
    return sorted(sorted(group) for group in groups if len(group) > 1)


def reachable(graph: dict[str, set[str]], start: str) -> set[str]:
    """All that a node leads to, itself only by a circle."""
    found: set[str] = set()
    waiting = list(graph[start])
    while waiting:
        node = waiting.pop()
        if node not in found:
            found.add(node)
            waiting += graph.get(node, ())
    return found


def fields_of(node: ast.ClassDef) -> int:
    """How many fields a record has that its constructor asks for."""
    given = [line for line in node.body if isinstance(line, ast.AnnAssign)]
    return sum("ClassVar" not in ast.unparse(line.annotation) and not is_made_inside(line) for line in given)


def is_made_inside(line: ast.AnnAssign) -> bool:
    """Whether a field is `field(init=False)`."""
    return isinstance(line.value, ast.Call) and any(
        word.arg == "init" and isinstance(word.value, ast.Constant) and word.value.value is False
        for word in line.value.keywords
    )


def kind_of_record(node: ast.ClassDef) -> tuple[str, Sequence[ast.keyword]] | None:
    """`dataclass`, `Struct` or `NamedTuple` with its options; None where a class is no record."""
    for decorator in node.decorator_list:
        if last_name(decorator) == "dataclass":
            return "dataclass", decorator.keywords if isinstance(decorator, ast.Call) else []
    kinds = RECORDS & {last_name(base) for base in node.bases}
    return (kinds.pop(), node.keywords) if kinds else None


def positional_records(packages: Sequence[Package], callers: Sequence[ast.AST]) -> list[list[str]]:
    """Wide records of each package that may be made, or named tuples that are made, of values without their names."""
    made = {last_name(call.func) for tree in callers for call in ast.walk(tree) if is_positional(call)}
    found: list[list[str]] = []
    for package in packages:
        found.append([])
        for where, node in package.classes:
            kind = kind_of_record(node)
            if kind is None or (count := fields_of(node)) < WIDE_RECORD:
                continue
            by_name = any(word.arg == "kw_only" and ast.unparse(word.value) == "True" for word in kind[1])
            if node.name in made if kind[0] == "NamedTuple" else not by_name:
                found[-1].append(f"{where} ({kind[0]} of {count} fields)")
    return found


def is_positional(node: ast.AST) -> bool:
    """Whether a node is a call with a value that has no name."""
    return isinstance(node, ast.Call) and bool(node.args)


def read_package(name: str, root: Path = ROOT) -> Package:
    """Parse the files of a package."""
    return Package(name, tuple(read_module(path, root) for path in sorted((root / name).rglob("*.py"))), root)


def read_module(path: Path, root: Path) -> Module:
    """Parse one file."""
    parts = path.relative_to(root).with_suffix("").parts
    text = path.read_text()
    return Module(".".join(parts[:-1] if parts[-1] == "__init__" else parts), path, text, ast.parse(text))


def counted(packages: Sequence[Package], find: Callable[[Package], list[str]]) -> Result:
    """Numbers of places in each package, which are to be 0."""
    return none_of([find(package) for package in packages])


def none_of(found: Sequence[list[str]]) -> Result:
    """The same of places already found."""
    places = tuple(where for each in found for where in each)
    return tuple(str(len(each)) for each in found), "0", places, not places


def shared(missed: Sequence[list[str]], totals: Sequence[int], bar: float) -> Result:
    """Shares of what is as it should be."""
    shares = [1.0 - len(each) / max(total, 1) for each, total in zip(missed, totals, strict=True)]
    places = tuple(where for each in missed for where in each)
    return tuple(f"{share:.1%}" for share in shares), f">= {bar:.0%}", places, min(shares) >= bar


def flat_files(packages: Sequence[Package]) -> Result:
    """How many files stand at the top of each package."""
    counts = [len(package.flat()) for package in packages]
    bars = [FLAT[package.name] for package in packages]
    full = [package for package, count, bar in zip(packages, counts, bars, strict=True) if count > bar]
    places = tuple(f"{package.name}/{name}" for package in full for name in package.flat())
    return tuple(map(str, counts)), f"<= {', '.join(map(str, bars))}", places, not full


def median_length(packages: Sequence[Package]) -> Result:
    """Half of the functions of each package are no longer than this."""
    values = [median(length(node) for _, node in package.functions) for package in packages]
    return tuple(f"{value:g}" for value in values), f"<= {MEDIAN}", (), max(values) <= MEDIAN


def annotated(packages: Sequence[Package]) -> Result:
    """The share of functions with a type for each argument and the result."""
    return shared([p.without_types() for p in packages], [len(p.typed_functions()) for p in packages], 0.99)


def documented(packages: Sequence[Package]) -> Result:
    """The share of public things with a docstring."""
    return shared([p.without_words() for p in packages], [len(p.public()) for p in packages], 0.97)


def measures(root: Path = ROOT) -> list[Measure]:
    """Every measure of the packages in a tree, in the order of MEASURES."""
    packages = [read_package(name, root) for name in PACKAGES]
    callers = [ast.parse(path.read_text()) for path in sorted((root / "tests").rglob("*.py"))]
    callers += [module.tree for package in packages for module in package.modules]
    results = (
        flat_files(packages),
        counted(packages, Package.long_modules),
        median_length(packages),
        counted(packages, Package.long_functions),
        annotated(packages),
        documented(packages),
        counted(packages, Package.poor_docstrings),
        none_of(positional_records(packages, callers)),
        counted(packages, Package.circles),
        counted(packages, Package.room_circles),
    )
    return [Measure(what, *result) for what, result in zip(MEASURES, results, strict=True)]


def main(words: Sequence[str]) -> int:
    """Print the table; 1 where a bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.code_measures", description=__doc__.splitlines()[0])
    parser.add_argument("--places", action="store_true", help="list what misses a bar or lowers a share")
    options = parser.parse_args(words)
    rows = measures()
    print(f"| measure | {' | '.join(PACKAGES)} | bar | kept |\n|{'---|' * (len(PACKAGES) + 3)}")
    for row in rows:
        print(f"| {row.what} | {' | '.join(row.values)} | {row.bar} | {'yes' if row.kept else 'no'} |")
    for row in rows if options.places else ():
        if row.places:
            print(f"\n{row.what}\n  " + "\n  ".join(row.places))
    return int(not all(row.kept for row in rows))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
