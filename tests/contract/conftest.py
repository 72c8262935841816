"""What the tests of all providers share."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def packings(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of these tests goes into the user's cache folder."""
    monkeypatch.setenv("MACROFIT_CACHE", str(tmp_path_factory.getbasetemp() / "packings"))


@pytest.fixture
def quiet() -> Iterator[None]:
    """Every warning is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield
