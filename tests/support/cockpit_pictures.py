"""Takes the pictures of docs/cockpit.md: python -m tests.support.cockpit_pictures

On an idle machine: the charts of round trip and lateness show what else it had to do.
"""

import sys
from pathlib import Path

from tests.support.browser import Browser, chromium, open_browser
from tests.support.cockpit_bench import cockpit

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "images"
DARK = [{"name": "prefers-color-scheme", "value": "dark"}]
_FOUR = "Four laws at 160 ms"


def main() -> None:
    """Take them."""
    program = chromium()
    if program is None:
        sys.exit("needs Chromium")
    with open_browser(program) as browser:
        browser.call("Emulation.setEmulatedMedia", features=DARK)
        browser.resize(1280, 720)
        with cockpit("--bus", "emulated") as (address, _):
            shown(browser, address, 1)
            browser.read("document.getElementById('gust').click()")
            browser.wait_for(f"cockpit.nowS > {browser.read('cockpit.nowS')} + 3")
            browser.screenshot(FOLDER / "cockpit.png")
        with cockpit("--bus", "emulated", "--scenario", _FOUR) as (address, _):
            shown(browser, address, 4)
            browser.screenshot(FOLDER / "cockpit_four.png")


def shown(browser: Browser, address: str, lanes: int) -> None:
    """Open the page, and wait until its charts are full."""
    browser.open(address)
    browser.wait_for(f"window.cockpit?.lanes.length === {lanes} && cockpit.nowS > 18")


if __name__ == "__main__":
    main()
