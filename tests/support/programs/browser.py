"""A headless Chromium, driven by the DevTools protocol over aiohttp's websocket.

``Browser`` runs its own event loop in the calling thread: every method waits for its answer, and
what the page does meanwhile (requests, console, exceptions) is kept.
"""

import asyncio
import base64
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_S = 120.0
"""How long a test waits for what does come: a busy machine takes its time."""
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-port=0",
)  # fmt: skip
_POLL_S = 0.1
_FEWER_PICTURES = """{
    const next = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (draw) => setTimeout(() => next(draw), 200);
}"""
"""Four pictures a second instead of sixty, which without a graphics processor take a core."""


def chromium() -> str | None:
    """Return the program to run; None where there is none."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Browser:
    """One page of a browser; use ``open_browser``."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._number = 0
        self._answers: dict[int, Any] = {}
        self.requests: list[str] = []
        self.complaints: list[str] = []

    async def connect(self, address: str) -> None:
        """Connect to the page at a websocket address."""
        self._session = aiohttp.ClientSession()
        self._socket = await self._session.ws_connect(address, max_msg_size=0)
        self._reader = asyncio.create_task(self._read())
        for domain in ("Page", "Runtime", "Network", "Log"):
            await self._call(f"{domain}.enable", {})
        slow = {"source": _FEWER_PICTURES}
        await self._call("Page.addScriptToEvaluateOnNewDocument", slow)

    async def disconnect(self) -> None:
        """Let go of the page."""
        self._reader.cancel()
        await self._socket.close()
        await self._session.close()

    def call(self, method: str, **parameters: Any) -> Any:
        """Call a method of the protocol; returns its result."""
        return self._loop.run_until_complete(self._call(method, parameters))

    def resize(self, width: int, height: int, *, is_phone: bool = False) -> None:
        """Give the page a size in pixels."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2 if is_phone else 1,
            mobile=is_phone,
        )

    def open(self, address: str) -> None:
        """Load a page."""
        self.call("Page.navigate", url=address)
        self.wait_for("document.readyState === 'complete'")

    def read(self, expression: str) -> Any:
        """Return the value of an expression in the page."""
        result = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in result:
            raise AssertionError(f"{expression}: {result['exceptionDetails']}")
        return result["result"].get("value")

    def wait_for(self, expression: str, patience_s: float = PATIENCE_S) -> Any:
        """Return the value of an expression when it has become true."""
        until_s = time.monotonic() + patience_s
        while not (value := self.read(expression)):
            assert time.monotonic() < until_s, f"never true: {expression}"
            self._loop.run_until_complete(asyncio.sleep(_POLL_S))
        return value

    def screenshot(self, file: Path) -> None:
        """Write the page as seen now, PNG."""
        answer = self.call("Page.captureScreenshot", format="png")
        file.write_bytes(base64.b64decode(answer["data"]))

    async def _call(self, method: str, parameters: dict[str, Any]) -> Any:
        self._number += 1
        number = self._number
        answer = self._loop.create_future()
        self._answers[number] = answer
        await self._socket.send_json({"id": number, "method": method, "params": parameters})
        return await asyncio.wait_for(answer, PATIENCE_S)

    async def _read(self) -> None:
        async for message in self._socket:
            content = json.loads(message.data)
            answer = self._answers.pop(content.get("id", -1), None)
            if answer is None:
                self._take_event(content)
            elif "error" in content:
                answer.set_exception(AssertionError(content["error"]["message"]))
            else:
                answer.set_result(content["result"])

    def _take_event(self, event: dict[str, Any]) -> None:
        """Keep what a test may ask about."""
        parameters = event.get("params", {})
        match event.get("method"):
            case "Network.requestWillBeSent":
                self.requests.append(parameters["request"]["url"])
            case "Network.webSocketCreated":
                self.requests.append(parameters["url"])
            case "Runtime.exceptionThrown":
                self.complaints.append(json.dumps(parameters["exceptionDetails"]))
            case "Runtime.consoleAPICalled" if parameters["type"] in ("error", "warning"):
                self.complaints.append(json.dumps(parameters["args"]))
            case "Log.entryAdded" if parameters["entry"]["level"] in ("error", "warning"):
                self.complaints.append(parameters["entry"]["text"])


@contextmanager
def open_browser(program: str) -> Iterator[Browser]:
    """Run a browser with one empty page until the end of the block."""
    loop = asyncio.new_event_loop()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        command = [program, *OPTIONS, f"--user-data-dir={folder}", "about:blank"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as it:
            try:
                browser = Browser(loop)
                address = loop.run_until_complete(_page_address(Path(folder)))
                loop.run_until_complete(browser.connect(address))
                yield browser
                loop.run_until_complete(browser.disconnect())
            finally:
                it.terminate()
                it.wait()
                loop.run_until_complete(loop.shutdown_asyncgens())
                loop.close()


async def _page_address(folder: Path) -> str:
    """Return the websocket address of the browser's first page, when it is there."""
    file = folder / "DevToolsActivePort"
    until_s = time.monotonic() + PATIENCE_S
    while not (file.exists() and file.read_text().count("\n")):
        assert time.monotonic() < until_s, "the browser does not start"
        await asyncio.sleep(_POLL_S)
    port = file.read_text().splitlines()[0]
    async with aiohttp.ClientSession() as session:
        while True:
            async with session.get(f"http://127.0.0.1:{port}/json/list") as answer:
                pages = [page for page in await answer.json() if page["type"] == "page"]
            if pages:
                return str(pages[0]["webSocketDebuggerUrl"])
            await asyncio.sleep(_POLL_S)
