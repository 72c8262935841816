"""Completion in the shell: keys of tables with their values, names that come with the package, and files.

Loaded where a shell asks only; what it completes from is read by the callbacks.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import click
from click.parser import split_arg_string
from click.shell_completion import BashComplete, CompletionItem, add_completion_class

KeyTable: TypeAlias = Mapping[str, Sequence[str]]
Complete: TypeAlias = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]

PLAIN = "COMPREPLY+=($value)"
NO_SPACE = f"{PLAIN}; [[ $value == *[=/] ]] && compopt -o nospace"


def items(words: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """The words that begin with what is written."""
    return [CompletionItem(word) for word in words if word.startswith(incomplete)]


def names_and_files(names: Iterable[str], incomplete: str, suffix: str = ".toml") -> list[CompletionItem]:
    """Names, files of a suffix and folders on the way to such files."""
    folder, _, begun = incomplete.rpartition("/")
    place = Path(folder or ("/" if incomplete.startswith("/") else "."))
    files = []
    for path in sorted(place.iterdir()) if place.is_dir() else ():
        hidden = path.name.startswith(".") and not begun
        if not hidden and (path.is_dir() or path.suffix == suffix):
            files.append(f"{incomplete[: len(incomplete) - len(begun)]}{path.name}{'/' * path.is_dir()}")
    return items([*names, *files], incomplete)


def keys_and_values(known: KeyTable, incomplete: str) -> list[CompletionItem]:
    """``key=`` for a key that is begun, and ``key=value`` behind the ``=``; of a list, its last value."""
    key, equals, value = incomplete.partition("=")
    if not equals:
        return items([f"{name}=" for name in known], incomplete)
    before, comma, _ = value.rpartition(",")
    return items([f"{key}={before}{comma}{each}" for each in known.get(key, ())], incomplete)


def values_given(context: click.Context, key: str) -> list[str]:
    """Values of a key in the overrides that stand before what is completed."""
    overrides = context.params.get("overrides") or ()
    return [text.partition("=")[2] for text in overrides if text.partition("=")[0] == key]


class Bash(BashComplete):
    """Bash, which takes ``key=value`` for three words, and sets a space behind a word unless it is told not to."""

    source_template = BashComplete.source_template.replace(PLAIN, NO_SPACE)
    apart = False

    def get_completion_args(self) -> tuple[list[str], str]:
        """The words before the one to complete, and that one; those around an ``=`` put together."""
        given = split_arg_string(os.environ["COMP_WORDS"])
        at = int(os.environ["COMP_CWORD"])
        words: list[str] = []
        joins = False
        for word in [*given, ""][1 : at + 1]:
            if words and (word == "=" or joins):
                words[-1] += word
            else:
                words.append(word)
            joins = word == "="
            self.apart = joins or (self.apart and words[-1].endswith(f"={word}"))
        incomplete = words.pop() if len(words) and at > 0 else ""
        return words, incomplete

    def format_completion(self, item: CompletionItem) -> str:
        """What bash is to put in the place of the word, for it what stands behind the ``=``."""
        value = item.value.rpartition("=")[2] if self.apart else item.value
        return f"{item.type},{value}"


def register() -> None:
    """Let click complete in bash as above."""
    add_completion_class(Bash, "bash")
