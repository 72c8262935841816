"""No dead link in the manual: files, anchors, names of benchmarks and paths of the tree; addresses are not fetched."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pages
import pytest
from benchmarks._book import names

LINK = re.compile(r"\]\(([^)\s]+)\)")
PATH = re.compile(r"`((?:macrofit|meso|surrogate|tests|docs|meshes)/[\w./-]+)`")
BENCHMARK = re.compile(r"(?:tests\.benchmarks|NAMES=)\s?\"?([a-z_]\w+)")
HEADING = re.compile(r"^#+ +(.+)$", re.MULTILINE)
TEXTS = [*pages.PAGES, *(pages.ROOT / name for name in ("meshes/README.md", "CHANGELOG.md", "CONTRIBUTING.md"))]


def plain(page: Path) -> str:
    """The text of a page without its blocks of code."""
    return pages.FENCE.sub("", page.read_text())


def anchors(page: Path) -> set[str]:
    """What the headings of a page are called in a link, as the site and the usual viewers have it."""
    found: set[str] = set()
    seen: Counter[str] = Counter()
    for heading in HEADING.findall(plain(page)):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", words.strip().lower()))
        found.add(f"{slug}_{seen[slug]}" if seen[slug] else slug)
        seen[slug] += 1
    return found


def places(page: Path) -> set[Path]:
    """The files that a page links to or shows."""
    return {(page.parent / link.partition("#")[0]).resolve() for link in LINK.findall(plain(page)) if "://" not in link}


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.stem)
def test_every_link_leads_somewhere(page: Path) -> None:
    dead = []
    for link in LINK.findall(plain(page)):
        place, _, anchor = link.partition("#")
        if "://" in link or link.startswith("mailto:"):
            continue
        target = (page.parent / place) if place else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            dead.append(link)
    assert not dead


@pytest.mark.parametrize("page", [page for page in TEXTS if page.stem != "CHANGELOG"], ids=lambda page: page.stem)
def test_paths_and_benchmarks_that_are_named_are_there(page: Path) -> None:
    text = plain(page)
    missing = [path for path in PATH.findall(text) if not (pages.ROOT / path).exists()]
    unknown = {name for name in BENCHMARK.findall(page.read_text())} - set(names()) - {"book"}
    assert not missing
    assert not unknown


def test_every_page_is_in_the_navigation() -> None:
    told = (pages.ROOT / "mkdocs.yml").read_text()
    assert [page.name for page in pages.PAGES if page.name != "README.md" and f": {page.name}\n" not in told] == []


def test_every_page_can_be_found_from_the_first() -> None:
    """By links alone, as a reader of the tree goes."""
    seen, ahead = set(), [pages.ROOT / "README.md"]
    while ahead:
        page = ahead.pop()
        seen.add(page)
        links = {
            (page.parent / link.partition("#")[0]).resolve() for link in LINK.findall(plain(page)) if ".md" in link
        }
        ahead += [link for link in links if link in pages.PAGES and link not in seen]
    assert seen == set(pages.PAGES)


def test_figures_of_the_folder_are_shown() -> None:
    """No picture is left behind that no page shows."""
    shown = {place for page in TEXTS for place in places(page)}
    there = {path for suffix in ("png", "svg") for path in (pages.ROOT / "docs").glob(f"*.{suffix}")}
    assert there - shown == set()
