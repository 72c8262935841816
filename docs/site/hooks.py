"""What mkdocs is told beside mkdocs.yml: the README as first page, files of the tree that pages link to, formulas.

Pages are written to be read in the tree, where `../meshes/README.md` is a link that works. The site has no tree around
it: each file that a page links to outside of docs/ comes along in the folder `tree` of the site.
"""

from __future__ import annotations

import html
import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from latex2mathml.converter import convert

if TYPE_CHECKING:
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"(\]\()([^)\s#]+)")
"""The target of a link or a picture, without its anchor."""
FORMULA = re.compile(r"\\([(\[])(.*?)\\[)\]]", re.DOTALL)
"""What arithmatex makes of $...$ and of $$...$$."""
STYLE = """
math[display=block] { margin: 0.8em 0; overflow-x: auto; }
td, th { font-size: 0.92em; }
table { display: block; overflow-x: auto; }
img { max-width: 100%; max-height: 34em; width: auto; }
"""


def on_files(files: Files, config: Any) -> Files:
    """Add the README as index.md, the style, and what the pages link to outside of docs/."""
    from mkdocs.structure.files import File
    from pygments.formatters import HtmlFormatter

    style = HtmlFormatter(style="default").get_style_defs(".highlight") + STYLE
    files.append(File.generated(config, "index.md", content=(ROOT / "README.md").read_text()))
    files.append(File.generated(config, "site.css", content=style))
    texts = {"README.md": (ROOT / "README.md").read_text()}
    texts |= {f"docs/{file.src_uri}": file.content_string for file in files.documentation_pages()}
    outside = {from_root(name, target) for name, text in texts.items() for _, target in LINK.findall(text)}
    for target in sorted(outside - {"README.md"}):
        if not target.startswith("docs/") and (ROOT / target).is_file():
            files.append(File.generated(config, f"tree/{target}", abs_src_path=str(ROOT / target)))
    return files


def from_root(page: str, target: str) -> str:
    """Where in the tree a link of a page leads; nothing for one to the network."""
    return "" if "://" in target else posixpath.normpath(posixpath.join(posixpath.dirname(page), target))


def on_page_markdown(markdown: str, page: Page, config: Any, files: Files) -> str:
    """Turn links of the tree into those of the site."""
    place = page.file.src_uri
    name = "README.md" if place == "index.md" else place.removeprefix("tree/") if "tree/" in place else f"docs/{place}"

    def turned(match: re.Match[str]) -> str:
        target = from_root(name, match[2])
        if not target:
            return match[0]
        inside = target.removeprefix("docs/") if target.startswith("docs/") else f"tree/{target}"
        inside = "index.md" if target == "README.md" else inside
        return match[1] + posixpath.relpath(inside, posixpath.dirname(place) or ".")

    return LINK.sub(turned, markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Formulas as MathML, which browsers draw by themselves."""

    def drawn(match: re.Match[str]) -> str:
        return convert(html.unescape(match[2]), display="block" if match[1] == "[" else "inline")

    parts = re.split(r'(<(?:span|div) class="arithmatex">.*?</(?:span|div)>)', content, flags=re.DOTALL)
    return "".join(FORMULA.sub(drawn, part) if "arithmatex" in part[:30] else part for part in parts)
