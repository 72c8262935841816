"""The templates of the pages, and what fills them: numbers that can be read back, pictures within the file."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ..base.files import read_regular
from ..base.provenance import version
from ..errors import OutputError

MOST_BYTES = 100_000_000
"""Size of a file of results that is read."""
CAPTIONS = {
    "stress.png": "Von Mises stress on the deformed section",
    "stress_entrance.png": "Von Mises stress at the seat's ends",
    "friction.png": "Coefficient of friction along the seat, and of the pairs of tiles met",
    "service.png": "Bending stress, slip over place and angle, criteria, and a revolution where friction works most",
    "distributions.png": "Distributions of the runs",
    "service-study.png": "Friction work, slip, criteria and Ruiz' parameter of the runs",
}
"""Pictures of a folder that its page shows, in this order; the others are drawn anew."""


def rendered(template: str, filled: Mapping[str, Any]) -> str:
    """The page of a template of this folder."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("macrofit", "report"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["upper_first"] = lambda text: text[:1].upper() + text[1:]
    return environment.get_template(template).render(filled, version=version())


class Numbers:
    """The numbers of a JSON file for a page: each carries its key and its exact value."""

    def __init__(self, tables: Mapping[str, Any]) -> None:
        self._tables = tables

    def __call__(self, key: str, factor: float = 1.0, unit: str = "", digits: int = 5) -> Markup:
        """The number of a key ("max_von_mises_MPa.axle.value") times a factor, with its unit; a dash for none."""
        value = self.value(key)
        if value is None:
            return Markup("–")
        shown = f"{factor * value:.{digits}g}"
        return Markup('<data data-key="{}" value="{!r}">{}</data>{}').format(
            key, value, shown, Markup("&nbsp;{}").format(unit) if unit else ""
        )

    def value(self, key: str) -> Any:
        """What the file has under a key."""
        found: Any = self._tables
        for part in key.split("."):
            found = found[int(part)] if isinstance(found, list | tuple) else found[part]
        return found


def pictures(folder: Path, most: int) -> tuple[list[dict[str, str]], list[str]]:
    """The pictures of a folder as (caption, address with the whole content), and the names of those left out.

    Args:
        folder: what a run or a study has written.
        most: what all of them may have together [bytes]; in the page they take a third more.
    """
    taken, left, size = [], [], 0
    for name, caption in CAPTIONS.items():
        if not (folder / name).is_file():
            continue
        content = read_regular(folder / name, MOST_BYTES)
        if size + len(content) > most:
            left.append(name)
            continue
        size += len(content)
        taken.append({"caption": caption, "address": f"data:image/png;base64,{base64.b64encode(content).decode()}"})
    return taken, left


def inline(figure: Any) -> Markup:
    """A figure of matplotlib as SVG within a page: as wide as its place, its words as text, no styles for others."""
    from matplotlib import rc_context

    text = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "macrofit"}):
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    drawn = text.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", drawn, flags=re.DOTALL)
    drawn = re.sub(r' (?:width|height)="[\d.]+pt"', "", drawn, count=2)
    return Markup(drawn.replace("<svg", '<svg stroke-linejoin="round"', 1))  # matplotlib has escaped its texts


def read_json(path: Path, keys: Iterable[str]) -> dict[str, Any]:
    """The tables of a JSON file of results, which must have these keys.

    Raises:
        OutputError: it cannot be read, or is of something else.
    """
    import msgspec

    try:
        tables = msgspec.json.decode(read_regular(path, MOST_BYTES), type=dict[str, Any])
    except (msgspec.MsgspecError, ValueError) as error:
        raise OutputError(f"{path}: cannot be read ({error}); compute it again") from None
    missing = [key for key in keys if key not in tables]
    if missing:
        raise OutputError(f"{path}: has no {missing[0]}: it is of another version of macrofit; compute it again")
    return tables
