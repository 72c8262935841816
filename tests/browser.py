"""A real browser without a window: Chromium, spoken to through a pipe in its own protocol, with nothing but Python."""

from __future__ import annotations

import json
import os
import select
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from macrofit.report.pdf import found_browser, headless

PATIENCE_S = 60.0


class Browser:
    """A page in Chromium: `open` it, `evaluate` a script in it, `press` keys; `asked` are the addresses it wanted."""

    def __init__(self, process: subprocess.Popen[bytes], read: int, write: int) -> None:
        self._process, self._read, self._write = process, read, write
        self._held, self._number, self._session = b"", 0, ""
        self.asked: list[str] = []
        self.errors: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def open(self, page: Path) -> None:
        """Load a file and wait until its scripts have run."""
        self.call("Page.navigate", url=page.resolve().as_uri())
        end = time.monotonic() + PATIENCE_S
        while self.evaluate("document.readyState") != "complete" or "blank" in self.evaluate("location.href"):
            assert time.monotonic() < end
            time.sleep(0.02)

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page."""
        found = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def numbers(self) -> list[tuple[str, float]]:
        """Key and value of each number of a JSON file in a page of macrofit."""
        found = self.evaluate("[...document.querySelectorAll('data[data-key]')].map(e => [e.dataset.key, +e.value])")
        return [(key, value) for key, value in found]

    def cells(self) -> list[tuple[str, str, str]]:
        """Run, column and value of each number in the table of a study."""
        found = self.evaluate(
            "[...document.querySelectorAll('data[data-run]')].map(e => [e.dataset.run, e.dataset.column, e.value])"
        )
        return [(run, column, value) for run, column, value in found]

    def press(self, key: str, code: int) -> None:
        """Press and release a key, as a user does."""
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """What the browser answers; events that come before it are kept."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer["error"]
                return answer["result"]
            self._keep(answer)

    def _keep(self, event: dict[str, Any]) -> None:
        if event.get("method") == "Network.requestWillBeSent":
            self.asked.append(event["params"]["request"]["url"])
        elif event.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded"):
            self.errors.append(json.dumps(event["params"]))

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._held:
            ready, *_ = select.select([self._read], [], [], PATIENCE_S)
            assert ready, "the browser says nothing"
            part = os.read(self._read, 1 << 20)
            assert part, "the browser has ended"
            self._held += part
        message, _, self._held = self._held.partition(b"\0")
        return json.loads(message)


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser of this machine, ended with the block."""
    place = found_browser()
    assert place is not None
    to_read, to_write = os.pipe(), os.pipe()  # what it reads from, what it writes to: its descriptors 3 and 4
    with tempfile.TemporaryDirectory(prefix="browser-", ignore_cleanup_errors=True) as profile:
        shell = f'exec 3<&{to_read[0]} 4>&{to_write[1]}; exec "$@"'
        process = subprocess.Popen(
            ["bash", "-c", shell, "browser", *headless(place, profile), "--remote-debugging-pipe"],
            pass_fds=(to_read[0], to_write[1]), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(to_read[0])
        os.close(to_write[1])
        try:
            yield Browser(process, to_write[0], to_read[1])
        finally:
            process.terminate()
            process.wait(PATIENCE_S)
            os.close(to_write[0])
            os.close(to_read[1])
