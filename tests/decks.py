"""A ring as decks of Abaqus and CalculiX in their dialects: r = 50 to 80, z = -30 to 0, bore and pushed rear face."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

R, Z = np.linspace(50.0, 80.0, 4), np.linspace(-30.0, 0.0, 7)
POINTS = [(r, z) for z in Z for r in R]
AREA = 900.0


def corners() -> list[list[int]]:
    """Quadrilaterals by the numbers of their nodes, from 1, counterclockwise."""
    n = len(R)
    return [
        [j * n + i + 1, j * n + i + 2, (j + 1) * n + i + 2, (j + 1) * n + i + 1]
        for j in range(len(Z) - 1)
        for i in range(n - 1)
    ]


BORE = [j * len(R) + 1 for j in range(len(Z))]
PUSHED = list(range(1, len(R) + 1))
BORE_CELLS = [j * (len(R) - 1) + 1 for j in range(len(Z) - 1)]
PUSHED_CELLS = [1, 2, 3]


def nodes(style: str = "{k}, {r}, {z}", scale: float = 1.0) -> str:
    """Data lines of the nodes."""
    return "\n".join(style.format(k=k, r=r * scale, z=z * scale) for k, (r, z) in enumerate(POINTS, 1))


def cells(kind: str = "CAX4", *, split: bool = False, first: int = 1) -> str:
    """The keyword and data lines of the elements."""
    rows = corners()
    if split:
        rows = [half for a, b, c, d in rows for half in ([a, b, c], [a, c, d])]
    body = "\n".join(f"{k}, " + ", ".join(map(str, row)) for k, row in enumerate(rows, first))
    return f"*ELEMENT, TYPE={kind}, ELSET=EALL\n{body}"


def second_order(kind: str, *, over_lines: bool = False) -> str:
    """Nodes and elements with middle nodes: CAX8, or CAX6 where the quadrilaterals are split."""
    points, middles = list(POINTS), dict[tuple[int, int], int]()
    rows = corners()
    if kind.startswith("CAX6"):
        rows = [half for a, b, c, d in rows for half in ([a, b, c], [a, c, d])]
    full = []
    for row in rows:
        extra = []
        for a, b in zip(row, [*row[1:], row[0]], strict=True):
            key = (min(a, b), max(a, b))
            if key not in middles:
                points.append(tuple(0.5 * (np.array(points[a - 1]) + np.array(points[b - 1]))))  # type: ignore[arg-type]
                middles[key] = len(points)
            extra.append(middles[key])
        full.append([*row, *extra])
    lines = ["*NODE", *(f"{k}, {r}, {z}" for k, (r, z) in enumerate(points, 1)), f"*ELEMENT, TYPE={kind}"]
    for k, row in enumerate(full, 1):
        cut = 4 if over_lines else len(row)
        lines.append(f"{k}, " + ", ".join(map(str, row[:cut])) + ("," if over_lines else ""))
        lines += [", ".join(map(str, row[cut:]))] if over_lines else []
    return "\n".join(lines)


def listed(keyword: str, name: str, members: list[int]) -> str:
    """A set with its members, four on a line."""
    rows = [", ".join(map(str, members[k : k + 4])) for k in range(0, len(members), 4)]
    return f"*{keyword}, {keyword}={name}\n" + "\n".join(rows)


def sets(bore: str = "BORE", pushed: str = "PUSHED") -> str:
    """Both boundaries as sets of nodes."""
    return listed("NSET", bore, BORE) + "\n" + listed("NSET", pushed, PUSHED)


def surfaces() -> str:
    """Both boundaries as faces of elements: S4 of the first column, S1 of the first row."""
    return (
        f"{listed('ELSET', 'EB', BORE_CELLS)}\n*SURFACE, TYPE=ELEMENT, NAME=BORE\nEB, S4\n*SURFACE, NAME=PUSHED\n"
        + "\n".join(f"{k}, S1" for k in PUSHED_CELLS)
    )


def plain() -> str:
    """The usual deck."""
    return f"*HEADING\na ring\n*NODE, NSET=NALL\n{nodes()}\n{cells()}\n{sets()}\n"


def in_parts(instance: str, sets_of_assembly: str) -> str:
    """Part, assembly and instance, as Abaqus/CAE writes them."""
    return (
        f"*Part, name=RING\n*Node\n{nodes()}\n{cells('CAX4R')}\n*End Part\n*Assembly, name=A\n{instance}\n"
        f"*End Instance\n{sets_of_assembly}\n*End Assembly\n"
    )


ONE = "*Instance, name=RING-1, part=RING"
OF_INSTANCE = sets("bore, instance=RING-1", "pushed, instance=RING-1")
LINES = (
    "*ELEMENT, TYPE=T3D2, ELSET=bore\n"
    + "\n".join(f"{100 + k}, {a}, {b}" for k, (a, b) in enumerate(pairwise(BORE)))
    + "\n*ELEMENT, TYPE=B21, ELSET=pushed\n"
    + "\n".join(f"{200 + k}, {a}, {b}" for k, (a, b) in enumerate(pairwise(PUSHED)))
)

READ: dict[str, Callable[[], str]] = {
    "quadrilaterals and node sets": plain,
    "lower case": lambda: plain().lower(),
    "reduced integration": lambda: plain().replace("CAX4", "CAX4R"),
    "hybrid triangles": lambda: f"*NODE\n{nodes()}\n{cells('CAX3H', split=True)}\n{sets()}",
    "surfaces of faces": lambda: f"*NODE\n{nodes()}\n{cells()}\n{surfaces()}",
    "second order": lambda: second_order("CAX8") + "\n" + sets(),
    "second order over two lines": lambda: second_order("CAX8R", over_lines=True) + "\n" + surfaces(),
    "second order triangles": lambda: second_order("CAX6") + "\n" + sets(),
    "three coordinates": lambda: plain().replace(nodes(), nodes("{k}, {r}, {z}, 0.")),
    "Fortran's exponents": lambda: plain().replace(nodes(), nodes("{k}, {r:.8E}, {z:.8E}").replace("E+", "D+")),
    "comments and blank lines": lambda: plain().replace("\n", "\n** said\n\n"),
    "no blanks, odd blanks": lambda: plain().replace(", ", ",").replace("*NSET,NSET=", "*Nset , nset = "),
    "a keyword over two lines": lambda: plain().replace("TYPE=CAX4, ELSET", "TYPE=CAX4,\nELSET"),
    "generated sets": lambda: (
        f"*NODE\n{nodes()}\n{cells()}\n*NSET, NSET=BORE, GENERATE\n1, {BORE[-1]}, {len(R)}\n"
        f"*NSET, NSET=PUSHED, GENERATE\n1, {len(R)}\n"
    ),
    "sets of sets": lambda: plain().replace("NSET=BORE", "NSET=N1") + "*NSET, NSET=BORE\nN1\n",
    "a part and its instance": lambda: in_parts(ONE, OF_INSTANCE),
    "labels behind the instance's name": lambda: in_parts(
        ONE, "*Nset, nset=bore\n" + "\n".join(f"RING-1.{k}" for k in BORE) + "\n" + listed("NSET", "pushed", PUSHED)
    ),
    "line elements": lambda: f"*NODE\n{nodes()}\n{cells()}\n{LINES}",
    "nodes as a surface": lambda: plain().replace("NSET=BORE", "NSET=NB") + "*SURFACE, TYPE=NODE, NAME=Bore\nNB, 1.\n",
    "plane stress, materials and steps": lambda: (
        plain().replace("CAX4", "CPS4")
        + "*MATERIAL, NAME=STEEL\n*ELASTIC\n206000., .3\n*STEP\n*STATIC\n*BOUNDARY\nPUSHED, 2, 2\n*END STEP\n"
    ),
    "a byte order mark and Windows' lines": lambda: "\xef\xbb\xbf" + plain().replace("\n", "\r\n"),
}

REFUSED: dict[str, tuple[Callable[[], str], str]] = {
    "a solid": (lambda: plain().replace("CAX4", "C3D8"), r"\*ELEMENT: TYPE=C3D8 is not read; write CAX3, CAX4"),
    "metres": (lambda: plain().replace(nodes(), nodes(scale=1e-3)), r"is it in metres\? then mesh\.unit = 'm'"),
    "generated nodes": (lambda: plain() + "*NGEN\n1, 4, 1\n", r"line \d+, \*NGEN: not read; write the nodes out"),
    "cylindrical nodes": (lambda: plain().replace("NSET=NALL", "SYSTEM=C"), r"SYSTEM=C is not read"),
    "two parts": (lambda: plain() + "*PART, NAME=A\n*PART, NAME=B\n", r"each body into a file of its own"),
    "a turned instance": (
        lambda: in_parts(ONE + "\n0., 0.\n0., 0., 0., 0., 0., 1., 90.", OF_INSTANCE),
        r"\*INSTANCE: turns its part",
    ),
    "a missing file": (lambda: plain() + "*INCLUDE, INPUT=more.inp\n", r"\*INCLUDE: no file 'more\.inp'"),
    "another plane": (lambda: plain().replace(nodes(), nodes("{k}, {r}, 0., {z}")), "third coordinate"),
    "a misspelt set": (lambda: plain().replace("BORE", "BOER"), r"no physical group 'bore'.*did you mean 'BOER'\?"),
    "a set of elements": (
        lambda: plain().replace("NSET=BORE", "NSET=X") + listed("ELSET", "BORE", BORE_CELLS),
        r"'BORE' holds no edges, or elements of the body",
    ),
    "a surface without faces": (
        lambda: f"*NODE\n{nodes()}\n{cells()}\n{surfaces().replace('EB, S4', 'EB')}",
        r"\*SURFACE: face '' is not read; write S1",
    ),
    "a face too many": (
        lambda: f"*NODE\n{nodes()}\n{cells('CAX3', split=True)}\n{surfaces()}",
        r"is a triangle and has no face S4",
    ),
    "a missing node": (lambda: plain().replace("\n7, ", "\n700, ", 1), r"names node or element 7, which is not there"),
    "a number that is none": (lambda: plain().replace("60.0", "6O.0"), r"\*NODE: has a field that is no number"),
    "an element cut off": (lambda: plain() + "*ELEMENT, TYPE=CAX4\n90, 1, 2\n", r"\*ELEMENT: has a field"),
    "twisted": (lambda: plain().replace("1, 1, 2, 6, 5", "1, 1, 6, 2, 5"), "twisted or flat at"),
}
