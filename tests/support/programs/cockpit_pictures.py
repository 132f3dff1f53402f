"""Takes the pictures of the cockpit: python -m tests.support.programs.cockpit_pictures [moving]

Two are of live runs, on an idle machine, since their charts of the round trip show what else it
had to do. ``moving`` takes the other alone, of runs in virtual time.
"""

import base64
import io
import sys
import tempfile
from pathlib import Path

from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.settings import with_values
from steer_by_wire.tools.cockpit.page import single_page
from steer_by_wire.tools.cockpit.replay import read_replay
from tests.support.programs.browser import Browser, chromium, open_browser
from tests.support.programs.cockpit_run import cockpit

FOLDER = Path(__file__).resolve().parents[3] / "docs" / "images"
DARK = [{"name": "prefers-color-scheme", "value": "dark"}]
_LIVE = {
    "cockpit.png": ("DDOB at 80 ms", 1, 0.115),
    "cockpit_four.png": ("Four laws at 160 ms", 4, 0.45),
}
"""By the picture's name: scenario, lanes, and the longest round trip of those in time [s]."""
_SPAN_S = 15
_SETTLED = f"""cockpit.nowS > {_SPAN_S + 5} && cockpit.lanes.every((rows) =>
    rows.columns.round_trip_s
        .subarray(rows.indexAt(cockpit.nowS - {_SPAN_S}), rows.length)
        .every((trip) => trip < {{}}))"""
"""Whether every lane was driven in time in all that the charts show; no number is not in time."""
_PATIENCE_S = 600.0

LAWS = {"highway_pd": "PD", "highway_predictor": "predictor"}
_RISE_S, _BEFORE_MS, _FROM_RISE_MS = 4.0, 30, 200
"""The network of both, which becomes slow."""
_FRAMES = [2.0 + 0.2 * number for number in range(55)]
_SIZE = (640, 170)


def main() -> None:
    """Take them."""
    program = chromium()
    if program is None:
        sys.exit("needs Chromium")
    with open_browser(program) as browser:
        browser.call("Emulation.setEmulatedMedia", features=DARK)
        take_moving(browser)
        if sys.argv[1:] != ["moving"]:
            take_live(browser)


def take_live(browser: Browser) -> None:
    """Take one lane and four, each behind a gust."""
    for file, (title, lanes, longest_s) in _LIVE.items():
        with cockpit("--bus", "emulated", "--scenario", title) as address:
            open_small(browser, address, lanes, longest_s)
            browser.read("document.getElementById('gust').click()")
            browser.wait_for(f"cockpit.nowS > {browser.read('cockpit.nowS')} + 3")
            shoot(browser, FOLDER / file)


def open_small(browser: Browser, address: str, lanes: int, longest_s: float) -> None:
    """Open the page, and wait until its charts are full of lanes that have settled.

    Small, since drawing without a graphics processor takes the time that the lanes need.
    """
    browser.resize(320, 160)
    browser.open(address)
    browser.wait_for(f"window.cockpit?.lanes.length === {lanes}")
    browser.wait_for(_SETTLED.format(longest_s), _PATIENCE_S)


def shoot(browser: Browser, file: Path) -> None:
    """Take the page at the size of a laptop."""
    browser.resize(1280, 720)
    before = browser.read("cockpit.drawn")
    browser.read("cockpit.touch()")
    browser.wait_for(f"cockpit.drawn > {before}")
    browser.screenshot(file)


def take_moving(browser: Browser) -> None:
    """Take two laws on the same network, below each other, while its latency rises."""
    strips = [strip(browser, preset) for preset in LAWS]
    pictures = []
    for pair in zip(*strips, strict=True):
        both = Image.new("RGB", (_SIZE[0], 2 * _SIZE[1] + 4))
        for number, picture in enumerate(pair):
            both.paste(picture, (0, number * (_SIZE[1] + 4)))
        pictures.append(both)
    pictures[0].save(
        FOLDER / "cockpit_moving.webp",
        save_all=True,
        append_images=pictures[1:],
        duration=[200] * (len(pictures) - 1) + [1500],
        loop=0,
        quality=30,
        method=3,
    )


def strip(browser: Browser, preset: str) -> list[Image.Image]:
    """Return the scene of one law at each of the times."""
    font = ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf", 14)
    with tempfile.TemporaryDirectory() as folder:
        log, page = Path(folder) / "run.log", Path(folder) / "run.html"
        run_virtual_pair(moving_plant(), controller_preset(preset), candump_log=log)
        page.write_text(single_page(read_replay([log]), preset), encoding="utf-8")
        browser.resize(_SIZE[0], 480)
        browser.open(page.as_uri())
        browser.wait_for("window.cockpit?.drawn > 0")
        browser.read("cockpit.player.toggle(); document.getElementById('deviation').click()")
        style = f"position: fixed; width: {_SIZE[0]}px; height: {_SIZE[1]}px"
        browser.read(f"document.getElementById('scene').style = {style!r}")
        pictures = []
        for time_s in _FRAMES:
            before = browser.read("cockpit.drawn")
            browser.read(f"cockpit.player.seek({time_s})")
            browser.wait_for(f"cockpit.drawn > {before}")
            data = browser.read("document.getElementById('scene').toDataURL()").partition(",")[2]
            picture = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")
            late_ms = _FROM_RISE_MS if time_s >= _RISE_S else _BEFORE_MS
            text = f"{LAWS[preset]}: commands {late_ms} ms late"
            pen = ImageDraw.Draw(picture)
            pen.text((_SIZE[0] - 12, 6), text, "#f0b429", font, "ra")
            pictures.append(picture)
    return pictures


def moving_plant() -> PlantSettings:
    """Return a sedan in a double lane change, with a latency that changes."""
    schedule = [
        {"time_s": at_s, "mean_s": 1e-3 * late_ms}
        for at_s, late_ms in ((0.0, _BEFORE_MS), (_RISE_S, _FROM_RISE_MS))
    ]
    values = {"duration_s": 14.0, "latency.downlink.schedule": schedule}
    return with_values(plant_preset("large_sedan"), values, "moving")


if __name__ == "__main__":
    main()
