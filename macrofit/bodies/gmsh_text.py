"""Texts of gmsh, counted before they are read: meshio makes points of what is missing, and node 0 is its last."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

Lines = list[bytes]

ENDED = (b"Nodes", b"Elements", b"PhysicalNames", b"Entities")
"""Sections of which a boundary or a body can be short without a word."""


def check_text(file: Path) -> None:
    """The sections of a text of gmsh 2.2 or 4.1 end, and hold what they announce; elements name nodes that are there.

    Files of another kind are left alone.

    Raises:
        ValueError: in words, what is wrong.
    """
    if file.suffix.lower() != ".msh":
        return
    lines = file.read_bytes().split(b"\n")
    version = lines[1].split()[:2] if len(lines) > 1 else []
    if version not in ([b"4.1", b"0"], [b"2.2", b"0"]):
        return
    at = {line.strip(): k for k, line in enumerate(lines) if line.startswith(b"$")}
    for section in ENDED:
        if b"$" + section in at and at.get(b"$End" + section, -1) < at[b"$" + section]:
            raise ValueError(f"its section {section.decode()} does not end; the file is cut off")
    if b"$Nodes" not in at or b"$Elements" not in at:
        return
    count, nodes_of = (_blocks_41, _nodes_of_41) if version[0] == b"4.1" else (_rows_22, _nodes_of_22)
    tags = {row.split()[0] for row in count(lines, at[b"$Nodes"], b"Nodes") if row.split()}
    rows = list(count(lines, at[b"$Elements"], b"Elements"))
    unknown = {tag for row in rows for tag in nodes_of(row)} - tags
    if unknown:
        raise ValueError(f"an element names node {unknown.pop().decode(errors='replace')}, which is not there")


def _rows_22(lines: Lines, start: int, section: bytes) -> Iterator[bytes]:
    """The rows of a section of version 2.2."""
    total = int(lines[start + 1])
    end = start + 2 + total
    if total < 0 or end >= len(lines) or lines[end].strip() != b"$End" + section:
        raise _miscounted(section)
    yield from lines[start + 2 : end]


def _nodes_of_22(row: bytes) -> list[bytes]:
    """The nodes of an element: behind its number, its kind, the number of its tags, and these."""
    words = row.split()
    return words[3 + int(words[2]) :]


def _blocks_41(lines: Lines, start: int, section: bytes) -> Iterator[bytes]:
    """The rows of a section of version 4.1, over its blocks: tags of nodes, or elements."""
    blocks, total = (int(word) for word in lines[start + 1].split()[:2])
    per_item = 2 if section == b"Nodes" else 1
    line, found = start + 2, 0
    for _ in range(min(blocks, len(lines))):
        count = int(lines[line].split()[3])
        yield from lines[line + 1 : line + 1 + count]
        found, line = found + count, line + 1 + per_item * count
    if found != total or lines[line].strip() != b"$End" + section:
        raise _miscounted(section)


def _nodes_of_41(row: bytes) -> list[bytes]:
    """The nodes of an element: behind its number."""
    return row.split()[1:]


def _miscounted(section: bytes) -> ValueError:
    return ValueError(f"its {section.decode().lower()} are not as many as it announces; the file is damaged")
