"""Decks of Abaqus and CalculiX: axisymmetric elements, with node sets, element sets and surfaces as boundaries.

Read are the keywords that describe a mesh; materials, steps and what belongs to them are passed over. Anything that
would make nodes or elements, or move them, is refused by its name.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np

from ..base.arrays import FloatArray
from ..base.files import read_regular
from ..errors import MeshError
from .raw import RawMesh

LARGEST = 1_000_000_000
"""Size of the largest file that is read [bytes]; a million triangles take some 1e8."""

DEPTH = 8
"""How deep files may include each other."""

REFUSED = {
    "NGEN": "write the nodes out",
    "NFILL": "write the nodes out",
    "NCOPY": "write the nodes out",
    "NMAP": "write the nodes out",
    "ELGEN": "write the elements out",
    "ELCOPY": "write the elements out",
    "SYSTEM": "write the nodes in global coordinates x = r, y = z",
    "SUBMODEL": "write the whole body",
    "SYMMETRIC MODEL GENERATION": "write the plane mesh alone",
}
"""Keywords that make or move a mesh, and what to do instead."""

KEYWORD = re.compile(r"[A-Z][A-Z0-9 &_/'().-]*")
"""What keywords look like, in capitals."""

ALIKE = 0.8
"""From which likeness on a keyword is a misspelt one of a mesh: *NODES and *ELEMNT are, *MODE is not."""

SOLID = re.compile(r"(?:CAX|CGAX|CPS|CPE|CPEG|M3D|STRI|S)([3468])(?:\D.*)?")
"""Elements whose corners are those of triangles and quadrilaterals in a plane."""

LINES = {
    **dict.fromkeys(("T2D2", "T3D2", "B21", "B31", "B23", "B33", "SAX1", "MAX1", "RAX2", "R2D2"), 2),
    **dict.fromkeys(("T2D3", "T3D3", "B22", "B32", "SAX2", "MAX2"), 3),
}
"""Elements along lines, with the number of their nodes."""

FACES = {3: ((0, 1), (1, 2), (2, 0)), 4: ((0, 1), (1, 2), (2, 3), (3, 0))}
"""Corners of the faces S1, S2... of triangles and quadrilaterals."""


@dataclass(frozen=True, kw_only=True)
class Keyword:
    """A keyword line with its parameters, names in capitals, and where it stands."""

    name: str
    parameters: dict[str, str]
    line: int
    data: list[list[str]] = field(default_factory=list)  # fields of the data lines

    def flag(self, name: str) -> bool:
        """Whether a parameter without a value is given."""
        return name in self.parameters


@dataclass(kw_only=True)
class Deck:
    """What was read so far: nodes and elements by their labels, sets by their names in capitals."""

    where: str
    nodes: dict[int, list[float]] = field(default_factory=dict)
    cells: dict[int, tuple[int, list[int]]] = field(default_factory=dict)  # corners, labels of the nodes
    lines: dict[int, list[int]] = field(default_factory=dict)
    nsets: dict[str, list[int]] = field(default_factory=dict)
    elsets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: list[Keyword] = field(default_factory=list)
    parts: list[str] = field(default_factory=list)
    instances: list[str] = field(default_factory=list)
    move: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def refuse(self, keyword: Keyword, said: str) -> MeshError:
        """The error of a keyword."""
        return MeshError(f"{self.where}, line {keyword.line}, *{keyword.name}: {said}")


def read_deck(path: Path, where: str) -> RawMesh:
    """Read a deck of Abaqus or CalculiX.

    Args:
        path: of the file.
        where: begins the message of an error.

    Raises:
        MeshError: what cannot be taken, with its line and what to write instead.
    """
    deck = Deck(where=where)
    for keyword in _keywords(path, where, 0):
        if keyword.name in REFUSED:
            raise deck.refuse(keyword, f"not read; {REFUSED[keyword.name]}")
        reader = READERS.get(keyword.name)
        if reader is None:
            _check_keyword(deck, keyword)
        try:
            if reader is not None:
                reader(deck, keyword)
        except (ValueError, IndexError, OverflowError):
            raise deck.refuse(keyword, "has a field that is no number where one belongs, or too few of them") from None
    return _raw(deck)


def _check_keyword(deck: Deck, keyword: Keyword) -> None:
    """What is passed over is a keyword by its form, and none of a mesh but for a letter: its data would be lost."""
    if not KEYWORD.fullmatch(keyword.name):
        raise deck.refuse(keyword, "is no keyword; a comment begins with two stars, **")
    close = difflib.get_close_matches(keyword.name, list(READERS), 1, ALIKE) if " " not in keyword.name else []
    if close:
        raise deck.refuse(keyword, f"is no keyword; did you mean *{close[0]}?")


def _keywords(path: Path, where: str, depth: int) -> Iterator[Keyword]:
    """The keywords with their data, those of included files in their place."""
    keyword: Keyword | None = None
    for number, text in _logical_lines(path):
        if not text.startswith("*"):
            if keyword is not None:
                keyword.data.append([part.strip() for part in text.rstrip().rstrip(",").split(",")])
            continue
        if keyword is not None:
            yield from _expanded(keyword, path, where, depth)
        head, *rest = (part.strip() for part in text[1:].split(","))
        pairs = (part.partition("=") for part in rest if part)
        parameters = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
        keyword = Keyword(name=" ".join(head.upper().split()), parameters=parameters, line=number)
    if keyword is not None:
        yield from _expanded(keyword, path, where, depth)


def _logical_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines without comments and blank ones; a keyword line that ends in a comma goes on in the next."""
    held, start = "", 0
    text = read_regular(path, LARGEST).decode("latin-1").removeprefix("\xef\xbb\xbf")
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        if held:
            line, number, held = held + line, start, ""
        if line.startswith("*") and line.endswith(","):
            held, start = line, number
            continue
        yield number, line
    if held:
        yield start, held


def _expanded(keyword: Keyword, path: Path, where: str, depth: int) -> Iterator[Keyword]:
    """The keyword itself, or those of the file it includes."""
    source = keyword.parameters.get("INPUT")
    if source is None:
        yield keyword
        return
    if keyword.name != "INCLUDE":
        raise MeshError(f"{where}, line {keyword.line}, *{keyword.name}: INPUT= is not read; write the data here")
    included = path.parent / source
    if depth == DEPTH or not included.is_file():
        said = "files include each other without end" if depth == DEPTH else f"no file '{source}' beside the deck"
        raise MeshError(f"{where}, line {keyword.line}, *INCLUDE: {said}")
    yield from _keywords(included, f"{where} (in {source})", depth + 1)


def _integer(text: str) -> int:
    """A label, also behind the name of an instance, as in PART-1-1.12."""
    return int(text.rpartition(".")[2])


def _real(text: str) -> float:
    return float(text.upper().replace("D", "E")) if text else 0.0


def _node(deck: Deck, keyword: Keyword) -> None:
    system = keyword.parameters.get("SYSTEM", "R").upper()
    if system != "R":
        raise deck.refuse(keyword, f"SYSTEM={system} is not read; write x = r, y = z")
    labels = []
    for row in keyword.data:
        label = int(row[0])
        point = [_real(text) for text in row[1:4]]
        if len(point) < 2:
            raise ValueError(label)
        if label in deck.nodes and deck.nodes[label] != [*point, 0.0][:3]:
            raise deck.refuse(keyword, f"node {label} is given twice, in two places; one deck holds one body")
        deck.nodes[label] = [*point, 0.0][:3]
        labels.append(label)
    _add(deck.nsets, keyword.parameters.get("NSET"), labels)


def _add(sets: dict[str, list[int]], name: str | None, labels: list[int]) -> None:
    if name:
        sets.setdefault(name.upper(), []).extend(labels)


def _element(deck: Deck, keyword: Keyword) -> None:
    kind = keyword.parameters.get("TYPE", "").upper()
    solid = SOLID.fullmatch(kind)
    count = int(solid.group(1)) if solid else LINES.get(kind.rstrip("H"), 0)
    if count == 0:
        raise deck.refuse(
            keyword,
            f"TYPE={kind or '(none)'} is not read; write CAX3, CAX4, CAX6 or CAX8 (also R, H, I, M), one body alone",
        )
    labels = []
    for label, nodes in _element_rows(keyword, count):
        if label in deck.cells or label in deck.lines:
            raise deck.refuse(keyword, f"element {label} is given twice; one deck holds one body")
        labels.append(label)
        if solid:
            deck.cells[label] = (count if count < 5 else count // 2, nodes)
        else:
            deck.lines[label] = nodes
    _add(deck.elsets, keyword.parameters.get("ELSET"), labels)


def _element_rows(keyword: Keyword, count: int) -> Iterator[tuple[int, list[int]]]:
    """Label and nodes of each element, which may go on over several data lines."""
    held: list[int] = []
    for row in keyword.data:
        held += [int(text) for text in row if text]
        if len(held) > count:
            yield held[0], held[1 : count + 1]
            if len(held) > count + 1:
                raise ValueError(held[0])
            held = []
    if held:
        raise ValueError(held[0])


def _set(deck: Deck, keyword: Keyword) -> None:
    kind = keyword.name
    sets = deck.nsets if kind == "NSET" else deck.elsets
    name = keyword.parameters.get(kind)
    if not name:
        raise deck.refuse(keyword, f"has no name; write *{kind}, {kind}=NAME")
    if keyword.flag("ELSET") and kind == "NSET":
        members = set(_members(deck.elsets, keyword.parameters["ELSET"]))
        labels = [node for each in members if each in deck.cells for node in deck.cells[each][1]]
        labels += [node for each in members if each in deck.lines for node in deck.lines[each]]
        _add(sets, name, labels)
        return
    labels = []
    for row in keyword.data:
        if keyword.flag("GENERATE"):
            first, last, *step = (_integer(text) for text in row if text)
            if last < first or (step and step[0] < 1):
                raise ValueError(row)
            known = sorted(deck.nodes if kind == "NSET" else deck.cells | deck.lines)
            every = range(first, last + 1, *step)
            labels += [label for label in known if label in every]
            continue
        for text in filter(None, row):
            labels += [_integer(text)] if re.fullmatch(r"(?:.*\.)?\d+", text) else _members(sets, text)
    _add(sets, name, labels)


def _members(sets: dict[str, list[int]], name: str) -> list[int]:
    """The members of a set, also behind the name of an instance."""
    name = name.strip('"').upper()
    found = sets.get(name, sets.get(name.rpartition(".")[2]))
    if found is None:
        raise ValueError(name)
    return found


def _part(deck: Deck, keyword: Keyword) -> None:
    deck.parts.append(keyword.parameters.get("NAME", "?"))
    if len(deck.parts) > 1:
        raise deck.refuse(
            keyword, f"parts {' and '.join(deck.parts)} in one deck; write each body into a file of its own"
        )


def _instance(deck: Deck, keyword: Keyword) -> None:
    deck.instances.append(keyword.parameters.get("NAME", "?"))
    if len(deck.instances) > 1:
        raise deck.refuse(keyword, "a second instance; write each body into a file of its own")
    if len(keyword.data) > 1:
        raise deck.refuse(keyword, "turns its part; write the nodes where they are, x = r, y = z")
    if keyword.data:
        deck.move = [*(_real(text) for text in keyword.data[0]), 0.0, 0.0, 0.0][:3]


def _surface(deck: Deck, keyword: Keyword) -> None:
    deck.surfaces.append(keyword)


READERS = {
    "NODE": _node,
    "ELEMENT": _element,
    "NSET": _set,
    "ELSET": _set,
    "PART": _part,
    "INSTANCE": _instance,
    "SURFACE": _surface,
}


def _raw(deck: Deck) -> RawMesh:
    """The deck with its nodes counted from 0."""
    labels = np.array(sorted(deck.nodes), dtype=np.int64)
    index = {int(label): k for k, label in enumerate(labels)}
    raw = RawMesh()
    raw.points = np.array([deck.nodes[int(label)] for label in labels], dtype=np.float64).reshape(-1, 3) + deck.move
    try:
        for size, target in ((3, raw.triangles), (6, raw.triangles), (4, raw.quads), (8, raw.quads)):
            rows = [[index[n] for n in nodes] for _, nodes in deck.cells.values() if len(nodes) == size]
            if rows:
                target.append(np.array(rows, dtype=np.int64))
        _boundaries(deck, index, raw)
    except KeyError as error:
        raise MeshError(f"{deck.where}: an element or set names node or element {error}, which is not there") from None
    return raw


def _boundaries(deck: Deck, index: dict[int, int], raw: RawMesh) -> None:
    """Sets of nodes, sets of line elements and surfaces, by their names."""
    for name, labels in deck.nsets.items():
        raw.nodes.setdefault(name, []).append(np.array([index[label] for label in labels], dtype=np.int64))
    for name, labels in deck.elsets.items():
        lines = [_ends([index[n] for n in deck.lines[label]], raw.points) for label in labels if label in deck.lines]
        if lines:
            raw.lines.setdefault(name, []).append(np.array(lines, dtype=np.int64))
        else:
            raw.others[name] = "elements"
    for keyword in deck.surfaces:
        _faces(deck, index, raw, keyword)


def _ends(nodes: list[int], points: FloatArray) -> list[int]:
    """The ends of a line element: of three nodes, whose order dialects do not agree on, those farthest apart."""
    pairs = list(combinations(nodes, 2))
    distance = [float(((points[a] - points[b]) ** 2).sum()) for a, b in pairs]
    return list(pairs[int(np.argmax(distance))])


def _faces(deck: Deck, index: dict[int, int], raw: RawMesh, keyword: Keyword) -> None:
    """A surface: faces S1, S2... of elements or of sets of them, or nodes."""
    name = keyword.parameters.get("NAME", "").upper()
    if keyword.parameters.get("TYPE", "ELEMENT").upper() not in ("ELEMENT", "NODE"):
        raise deck.refuse(keyword, "write TYPE=ELEMENT with faces S1, S2, S3, S4, or TYPE=NODE")
    if keyword.parameters.get("TYPE", "").upper() == "NODE":
        for row in keyword.data:
            labels = [_integer(row[0])] if row[0].isdigit() else _known(deck, keyword, deck.nsets, row[0])
            raw.nodes.setdefault(name, []).append(np.array([index[label] for label in labels], dtype=np.int64))
        return
    for row in keyword.data:
        members, face = row[0], (row[1].upper() if len(row) > 1 else "")
        single = re.fullmatch(r"(?:.*\.)?\d+", members)
        labels = [_integer(members)] if single else _known(deck, keyword, deck.elsets, members)
        if not re.fullmatch(r"S[1-4]", face):
            raise deck.refuse(keyword, f"face '{face}' is not read; write S1, S2, S3 or S4 behind each set")
        ends = []
        for label in labels:
            corners, nodes = deck.cells[label]
            if int(face[1]) > corners:
                raise deck.refuse(keyword, f"element {label} is a triangle and has no face {face}")
            ends.append([index[nodes[k]] for k in FACES[corners][int(face[1]) - 1]])
        raw.lines.setdefault(name, []).append(np.array(ends, dtype=np.int64).reshape(-1, 2))


def _known(deck: Deck, keyword: Keyword, sets: dict[str, list[int]], name: str) -> list[int]:
    try:
        return _members(sets, name)
    except ValueError:
        raise deck.refuse(keyword, f"no set '{name}'") from None
