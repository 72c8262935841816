"""What is made of the code is as the code is: the page of keys, and the site without a warning."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType

import pages
import pytest


def loaded(name: str) -> ModuleType:
    """A script of docs/, which is no package."""
    path = pages.ROOT / "docs" / name
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_page_of_keys_is_that_of_the_records() -> None:
    keys = loaded("site/keys.py")
    assert keys.PAGE.read_text() == keys.page(), "type: python docs/site/keys.py"


def test_every_key_has_a_meaning() -> None:
    """And every default is a value, not the name of a Python object."""
    rows = re.findall(r"^\| `(\w+)` \|(.*)\|(.*)\|(.*)\|$", (pages.ROOT / "docs" / "keys.md").read_text(), re.MULTILINE)
    assert len(rows) > 120
    assert [key for key, default, values, meaning in rows if not meaning.strip() or not values.strip()] == []
    assert [key for key, default, *_ in rows if re.search("object|<|UNSET", default)] == []


class Addresses(HTMLParser):
    """Every address of a page of the site, and every name that a link may lead to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.names: set[str] = set()
        self.formulas = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {key: value or "" for key, value in attrs}
        self.names.add(values.get("id", ""))
        self.formulas += tag == "math"
        if tag == "a":
            self.links.append(values.get("href", ""))
        elif tag in ("img", "script", "link", "iframe") and values.get("rel") != "canonical":
            self.loads.append(values.get("src") or values.get("href", ""))


@pytest.mark.slow
def test_the_site_has_no_warning_and_needs_no_network(tmp_path: Path) -> None:
    """`make docs`, its pages read back: nothing is loaded from elsewhere, no link is dead, formulas are drawn."""
    pytest.importorskip("mkdocs", reason="make setup-docs brings it")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"],
        cwd=pages.ROOT, env=os.environ | {"PYTHONNOUSERSITE": "1"}, capture_output=True, text=True, timeout=200,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    assert "WARNING" not in built.stderr
    site = {path: Addresses(path.read_text()) for path in (tmp_path / "site").rglob("*.html") if path.stem != "404"}
    dead = []
    for path, found in site.items():
        assert [load for load in found.loads if "//" in load] == [], path
        for link in found.links:
            place, _, anchor = link.partition("#")
            target = (path.parent / place).resolve() if place else path
            if "://" not in link and not (target.exists() and (not anchor or anchor in site[target].names)):
                dead.append(f"{path.name}: {link}")
    assert dead == []
    theory = (tmp_path / "site" / "theory.html").read_text()
    assert site[tmp_path / "site" / "theory.html"].formulas > 40
    assert "$" not in re.sub(r"<(script|style|code).*?</\1>", "", theory, flags=re.DOTALL)
    assert "macrofit.solve.solve" in site[tmp_path / "site" / "api.html"].names
