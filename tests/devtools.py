"""A headless Chromium driven over its DevTools pipe: pages opened, scripts run, keys pressed, pictures taken.

The protocol runs over two inherited file descriptors (`--remote-debugging-pipe`: 3 in, 4 out, messages end in a zero
byte), so no port is opened and no client library is needed. https://chromedevtools.github.io/devtools-protocol/
"""

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
SWITCHES = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-quic", "--disable-dev-shm-usage", "--hide-scrollbars",
    "--remote-debugging-pipe", "--force-color-profile=srgb",
)  # fmt: skip
PATIENCE = 180.0  # s for one answer; a loaded machine starts a browser slowly
KEYS = {"ArrowRight": 39, "ArrowLeft": 37, "ArrowUp": 38, "ArrowDown": 40, "Home": 36, "End": 35}


def find_browser() -> str | None:
    """The path of a Chromium, None where there is none."""
    return next((found for found in map(shutil.which, NAMES) if found), None)


@dataclass
class Browser:
    """A running browser with one page open in it, and everything that the page complained about.

    Attributes
    ----------
    complaints : texts of errors and warnings on the console and of exceptions
    requests : addresses that were asked for, the page's own included
    """

    to_browser: int
    from_browser: int
    session: str = ""
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)
    _loaded: bool = False
    _number: int = 0
    _waiting: bytes = b""

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The result of a method of the protocol; AssertionError where the browser refuses it or says nothing."""
        return self._answer(self._ask(method, parameters), method)

    def _ask(self, method: str, parameters: dict[str, Any]) -> int:
        """The number of a message that is on its way."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        text = json.dumps(message).encode() + b"\0"
        while text:
            text = text[os.write(self.to_browser, text) :]
        return self._number

    def _answer(self, number: int, method: str) -> dict[str, Any]:
        while True:
            answer = self._receive()
            if answer.get("id") == number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return dict(answer["result"])
            self._notice(answer)

    def open(self, file: Path, *, fragment: str = "") -> None:
        """The page of a file, loaded and its scripts run."""
        self._loaded = False
        self.send("Page.navigate", url="about:blank")
        self._until_loaded()
        self.complaints.clear()
        self.requests.clear()
        self._loaded = False
        self.send("Page.navigate", url=file.resolve().as_uri() + fragment)
        self._until_loaded()
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def show(self, file: Path) -> None:
        """The page of a file, opened where it is not there already; else as it was left."""
        if self.run("location.pathname") != file.resolve().as_posix():
            self.open(file)

    def run(self, script: str) -> Any:
        """The value of an expression in the page, awaited; AssertionError with its exception."""
        found = self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, condition: str) -> None:
        """Returns when an expression of the page is true; AssertionError where it stays false for 10 s."""
        frames = f"if ({condition}) return true; await new Promise(done => setTimeout(done, 20));"
        held = self.run(f"(async () => {{ for (let n = 0; n < 500; n++) {{ {frames} }} return false; }})()")
        assert held, f"never true: {condition}"

    def text(self, selector: str) -> str:
        """The text of the first element of a selector."""
        return str(self.run(f"document.querySelector({json.dumps(selector)}).textContent"))

    def press(self, key: str, *, times: int = 1) -> None:
        """A key pressed as a user does it, in the element that has the focus, again without waiting for the page."""
        method, what = "Input.dispatchKeyEvent", {"key": key, "code": key, "windowsVirtualKeyCode": KEYS[key]}
        asked = [self._ask(method, {"type": kind, **what}) for _ in range(times) for kind in ("keyDown", "keyUp")]
        for number in asked:
            self._answer(number, method)

    def click(self, x: float, y: float) -> None:
        """A click of the left button at CSS pixels of the window."""
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            button = "none" if kind == "mouseMoved" else "left"
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=1)

    def point_at(self, x: float, y: float) -> None:
        """The pointer moved to CSS pixels of the window."""
        for step in (3, 0):
            self.send("Input.dispatchMouseEvent", type="mouseMoved", x=x - step, y=y - step)

    def size(self, width: int, height: int = 900) -> None:
        """The window's size in CSS pixels."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def colours(self, scheme: str) -> None:
        """What the system prefers: 'light' or 'dark'."""
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def picture(self, file: Path, *, of: str = "html") -> Path:
        """A PNG of the first element of a selector, the whole page by default."""
        box = self.run(
            f"(() => {{ const b = document.querySelector({json.dumps(of)}).getBoundingClientRect();"
            "return {x: b.x + scrollX, y: b.y + scrollY, width: b.width, height: b.height}; })()"
        )
        made = self.send("Page.captureScreenshot", captureBeyondViewport=True, clip={**box, "scale": 1})
        file.write_bytes(base64.b64decode(made["data"]))
        return file

    def paper(self, file: Path) -> Path:
        """The page as PDF, as its own style sheet wants it on paper."""
        made = self.send("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
        file.write_bytes(base64.b64decode(made["data"]))
        return file

    def _until_loaded(self) -> None:
        while not self._loaded:
            self._notice(self._receive())

    def _notice(self, event: dict[str, Any]) -> None:
        given = event.get("params", {})
        match event.get("method"):
            case "Page.loadEventFired":
                self._loaded = True
            case "Runtime.exceptionThrown":
                details = given["exceptionDetails"]
                self.complaints.append(details.get("exception", {}).get("description", details["text"]))
            case "Runtime.consoleAPICalled" if given["type"] in ("error", "warning", "assert"):
                self.complaints.append(" ".join(str(a.get("value", a.get("description"))) for a in given["args"]))
            case "Log.entryAdded" if given["entry"]["level"] in ("error", "warning"):
                self.complaints.append(f"{given['entry']['text']} {given['entry'].get('url', '')}")
            case "Network.requestWillBeSent":
                self.requests.append(given["request"]["url"])

    def _receive(self) -> dict[str, Any]:
        deadline = time.monotonic() + PATIENCE
        while b"\0" not in self._waiting:
            ready, _, _ = select.select([self.from_browser], [], [], max(0.0, deadline - time.monotonic()))
            assert ready, f"the browser said nothing for {PATIENCE:g} s"
            piece = os.read(self.from_browser, 1 << 20)
            assert piece, "the browser has ended"
            self._waiting += piece
        message, self._waiting = self._waiting.split(b"\0", 1)
        return dict(json.loads(message))


def hand_over(read: int, write: int) -> None:
    """In the child, both ends become the protocol's descriptors 3 and 4, kept by the browser.

    The copies lie above them: a copy that were 3 or 4 itself, because these are free (matplotlib closes its fonts' in a
    child), would end with the start of the browser, for copying it onto itself changes nothing.
    """
    spare = [fcntl.fcntl(one, fcntl.F_DUPFD, 5) for one in (read, write)]
    for one, place in zip(spare, (3, 4), strict=True):
        os.dup2(one, place)
        os.close(one)


@contextmanager
def started(program: str, profile: Path) -> Iterator[Browser]:
    """A browser with an empty page, ended afterwards; its profile goes into the folder."""
    read_there, write_here = os.pipe()
    read_here, write_there = os.pipe()

    process = subprocess.Popen(
        [program, *SWITCHES, f"--user-data-dir={profile}", "about:blank"],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        close_fds=False, preexec_fn=lambda: hand_over(read_there, write_there),
    )  # fmt: skip
    os.close(read_there)
    os.close(write_there)
    browser = Browser(write_here, read_here)
    try:
        target = next(t for t in browser.send("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = browser.send("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        browser.session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            browser.send(f"{domain}.enable")
        yield browser
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        os.close(write_here)
        os.close(read_here)
