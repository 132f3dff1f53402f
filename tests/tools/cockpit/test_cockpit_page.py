"""The cockpit's page in a headless Chromium: a live loop, a foreign bus, a replay from a disk."""

import re
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.dbc.messages import Direction, LatencyModel, decode, encode
from steer_by_wire.runtime.frame.message import frame_of, message_of
from steer_by_wire.tools.cockpit.__main__ import main
from tests.support.frames.made_messages import error_of, latency_of
from tests.support.programs.browser import Browser, chromium, open_browser
from tests.support.programs.cockpit_run import cockpit
from tests.support.programs.cockpit_run import log as log

PROGRAM = chromium()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium here (package chromium)")
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser(PROGRAM or "") as found:
        found.resize(1280, 720)
        yield found


def opened(browser: Browser, address: str) -> None:
    """Open the page, and let it draw."""
    browser.open("about:blank")  # the page before may still look for its server
    browser.requests.clear()
    browser.complaints.clear()
    browser.open(address)
    browser.wait_for("window.cockpit?.drawn > 2")


def in_order(browser: Browser, address: str) -> None:
    """Assert that the page complained of nothing and asked for nothing but from its server."""
    assert browser.complaints == []
    allowed = (address, address.replace("http:", "ws:"), "data:")
    assert [request for request in browser.requests if not request.startswith(allowed)] == []
    assert browser.requests


def light(name: str) -> str:
    """Return an expression for the state that a light of the shown lane has."""
    return (
        "[...document.querySelectorAll('#lights li')]"
        f".find((item) => item.querySelector('.name').textContent === '{name}')"
        "?.querySelector('b').textContent"
    )


def slide(identifier: str, value: float) -> str:
    """Return an expression that moves a slider as a hand does."""
    return (
        f"(() => {{ const slider = document.getElementById('{identifier}');"
        f" slider.value = {value}; slider.dispatchEvent(new Event('input')); }})()"
    )


def value_of(signal: str) -> str:
    """Return an expression for the newest value of a signal of the first lane."""
    return f"cockpit.lanes[0]?.value('{signal}', cockpit.nowS)"


def press(*words: str) -> str:
    """Return an expression that presses the buttons with these words or titles."""
    return (
        f"{list(words)!r}.forEach((word) => [...document.querySelectorAll('button')]"
        ".find((button) => button.textContent === word || button.title === word).click())"
    )


def begin(browser: Browser, title: str) -> None:
    """Start a preset."""
    browser.wait_for("document.getElementById('preset')")
    browser.read(f"document.getElementById('preset').value = {title!r}")
    browser.read(press("Start"))


def test_a_foreign_bus_gets_the_frame_that_the_slider_asks_for(browser: Browser) -> None:
    with (
        launched_broker() as broker,
        can.Bus(interface="emulated", channel="foreign", address=broker) as bus,
    ):
        where = ("-i", "emulated", "-c", "foreign", "--bus-kwargs", f"address={broker}")
        with cockpit(*where, "--allow-control") as address:
            opened(browser, address)
            bus.send(message_of(encode(error_of(0.0421), 0)))
            browser.wait_for("document.querySelector('#figures').innerText.includes('42.1')")
            browser.read(slide("uplink-mean_s", 35))
            got = bus.recv(PATIENCE_S)
            in_order(browser, address)
        assert got is not None
        wanted = latency_of(Direction.UPLINK, 0.035, model=LatencyModel.NORMAL)
        assert decode(frame_of(got)) == decode(encode(wanted, 0))
        with cockpit(*where) as address:
            opened(browser, address)
            assert browser.read("document.getElementById('uplink-mean_s').disabled")
            in_order(browser, address)


@pytest.fixture(scope="module")
def replay(log: Path) -> Iterator[str]:
    """The page of a recording."""
    with cockpit(str(log)) as address:
        yield address


def test_a_replay_shows_the_figures_of_the_analysis(
    browser: Browser, log: Path, replay: str
) -> None:
    opened(browser, replay)
    browser.read("cockpit.player.seek(cockpit.player.durationS)")
    car = analyse_files([log]).figures["signals"]["cg_deviation_m"]
    wanted_mm = [1e3 * car["rms"], 1e3 * abs(car["peak"])]
    browser.wait_for("document.querySelector('#timeline span').textContent.startsWith('12.0')")
    text: str = browser.read("document.querySelector('#figures tbody').innerText")
    shown_mm = [float(figure) for figure in re.findall(r"\d+\.\d+", text)[:2]]
    assert shown_mm == pytest.approx(wanted_mm, abs=0.00501)  # half of the last digit shown
    in_order(browser, replay)


def choose(label: str, value: str) -> str:
    """Return an expression that gives a control, by its name, another value."""
    return (
        f"(() => {{ const box = document.querySelector('[aria-label=\"{label}\"]');"
        f" box.value = '{value}'; box.dispatchEvent(new Event('change')); }})()"
    )


def test_a_chart_shows_the_signal_scale_and_span_that_are_chosen(
    browser: Browser, replay: str
) -> None:
    opened(browser, replay)
    browser.read("cockpit.player.seek(cockpit.player.durationS)")
    browser.read(choose("Round trip: signal", "rms_m"))
    browser.read(choose("Round trip: scale", "50"))
    chart = "document.querySelector('[aria-label=\"Round trip, mm\"]')"
    browser.wait_for(f"{chart} !== null")
    browser.read("cockpit.charts.setZoom([2, 6])")
    browser.wait_for(f"/^mean /.test({chart}.querySelector('.values b').innerText)")
    shown = browser.read(f"{chart}.querySelector('.values b').innerText")
    column = browser.read(
        "[...Array(201).keys()].map((k) => 1000 * cockpit.lanes[0].value('rms_m', 2 + k / 50))"
    )
    figures = [float(figure) for figure in re.findall(r"\d+\.\d+", shown)]
    rms = (sum(value * value for value in column) / len(column)) ** 0.5
    wanted = [sum(column) / len(column), rms, min(column), max(column)]
    assert figures == pytest.approx(wanted, rel=0.01)
    in_order(browser, replay)


def test_an_exported_replay_plays_from_a_disk(browser: Browser, log: Path, tmp_path: Path) -> None:
    file = tmp_path / "run.html"
    assert main([str(log), "--export", str(file)]) == 0
    opened(browser, file.as_uri())
    browser.wait_for("cockpit.player.nowS > 0.5")
    browser.read("cockpit.player.toggle(); cockpit.player.seek(6)")
    browser.wait_for("document.querySelector('#timeline span').textContent.startsWith('6.0 / ')")
    before = browser.read("cockpit.player.nowS")
    browser.read("document.getElementById('speed').value = '10'")
    browser.read("document.getElementById('speed').dispatchEvent(new Event('change'))")
    browser.read("cockpit.player.toggle()")
    browser.wait_for(f"cockpit.player.nowS > {before} + 3")
    in_order(browser, file.as_uri())


def test_the_page_fits_a_phone(browser: Browser, replay: str) -> None:
    browser.resize(390, 844, is_phone=True)
    opened(browser, replay)
    assert browser.read("document.documentElement.scrollWidth") == 390
    browser.resize(1280, 720)
    assert browser.read("document.documentElement.scrollHeight") <= 720
    assert browser.complaints == []


@pytest.fixture(scope="module")
def live() -> Iterator[str]:
    """The page of a live loop."""
    with cockpit("--bus", "emulated") as address:
        yield address


def test_every_control_has_a_name_for_a_screen_reader(browser: Browser, live: str) -> None:
    opened(browser, live)
    browser.wait_for("document.getElementById('preset')")
    tree = browser.call("Accessibility.getFullAXTree")["nodes"]
    roles = ("button", "slider", "combobox", "textbox", "spinbutton", "tab", "img", "link")
    controls = [node for node in tree if node.get("role", {}).get("value") in roles]
    assert len(controls) > 25
    assert [node for node in controls if not node.get("name", {}).get("value")] == []


def test_a_live_loop_is_watched_driven_and_recorded(
    browser: Browser, live: str, tmp_path: Path
) -> None:
    opened(browser, live)
    browser.wait_for(f"{light('Controller')} === 'ACTIVE'")
    browser.wait_for(f"{light('Steering')} === 'APPLYING'")
    browser.wait_for(f"Math.abs({value_of('downlink_s')} - 0.08) < 0.001")

    # The slider sends LATENCY_CONFIG; that the plant reports the latency shows that it came.
    browser.read(slide("downlink-mean_s", 140))
    browser.wait_for(f"Math.abs({value_of('downlink_s')} - 0.14) < 0.001")
    browser.wait_for(f"{value_of('round_trip_s')} > 0.14")

    # A disturbance over the bus leaves its mark in the error.
    browser.read("document.getElementById('offset').click()")
    browser.wait_for(f"Math.abs({value_of('lateral_error_m')}) > 0.002")

    browser.read(press("Kill controller of practical pd ddob"))
    browser.wait_for(f"{light('Steering')} === 'FALLBACK'")
    browser.wait_for("/Controller: SILENT/.test(document.getElementById('said').textContent)")
    browser.read(press("Restart controller of practical pd ddob"))
    browser.wait_for(f"{light('Controller')} === 'ACTIVE'")
    browser.wait_for(f"['APPLYING', 'LIMITED BY SAFETY'].includes({light('Steering')})")

    browser.read(press("Pause plant of practical pd ddob"))
    browser.wait_for(f"{light('Steering')} === 'SILENT'")
    browser.read(press("Resume plant of practical pd ddob"))
    browser.wait_for(f"{light('Steering')} !== 'SILENT'")
    browser.wait_for(f"{light('Controller')} === 'ACTIVE'")

    begin(browser, "DDOB with varying delay")
    browser.wait_for("cockpit.lanes.length === 4 && cockpit.drawn")
    laws = "cockpit.status.lanes.map((lane) => lane.law)"
    browser.wait_for(f"{laws}.join() === 'PD,PID,PD_CDOB,PD_DDOB'")
    browser.read("cockpit.wish({ do: 'record', on: true })")
    browser.wait_for("cockpit.status.recording_s > 0.5")
    browser.read("cockpit.wish({ do: 'record', on: false })")
    browser.wait_for("cockpit.status.recording_s === null")
    file = tmp_path / "lane2.log"
    file.write_text(browser.read("fetch('recording/lane2.log').then((it) => it.text())"), "ascii")
    in_order(browser, live)
    assert analyse_files([file]).figures["laws"] == ["PID"]


NOTE_BEGIN = """
    const wish = cockpit.wish;
    cockpit.wish = (what) => {
      if (what.do === "reset") window.begunS = cockpit.nowS;
      return wish.call(cockpit, what);
    };
    0
"""


def key(browser: Browser, kind: str, name: str) -> None:
    browser.call("Input.dispatchKeyEvent", type=kind, key=name, code=name)


SECOND_FINGER = """{
    const box = document.getElementById("wheel"), pointerId = 77;
    for (const kind of ["pointerdown", "pointermove", "pointerup", "lostpointercapture"])
        box.dispatchEvent(new PointerEvent(kind, { pointerId, clientX: 5, clientY: 5 }));
    0
}"""
"""Touches the wheel elsewhere while a first one holds it."""


def drag(browser: Browser, from_x: float, from_y: float, to_x: float, meanwhile: str = "0") -> None:
    """Take the picture of the wheel, pull it, and keep it; in radii of the rim from its middle."""
    box = "document.getElementById('wheel').getBoundingClientRect()"
    x, y, width = browser.read(f"[{box}.x, {box}.y, {box}.width]")
    for kind, at in (("mousePressed", from_x), ("mouseMoved", to_x)):
        where = {"x": x + width * (0.5 + 0.4 * at), "y": y + width * (0.5 + 0.4 * from_y)}
        browser.call("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **where)
        browser.read(meanwhile)


def let_go(browser: Browser) -> None:
    browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=0, y=0, button="left")


def test_keys_pointer_and_gamepad_steer_the_car_over_the_bus(browser: Browser, live: str) -> None:
    browser.read("delete navigator.getGamepads")
    opened(browser, live)
    begin(browser, "Drive it: 250 ms")
    browser.wait_for("cockpit.isDriven && cockpit.lanes.length && cockpit.nowS > 0.1")
    browser.read(NOTE_BEGIN)
    key(browser, "keyDown", "ArrowLeft")
    browser.wait_for(f"{value_of('steer_rad')} > 0.01")
    steered = "Number.isFinite(cockpit.lanes[0].value('steer_rad', begunS - {}))"
    browser.wait_for("window.begunS !== undefined")
    assert [browser.read(steered.format(before_s)) for before_s in (0.0, 1.0)] == [True, False]
    browser.wait_for(f"{value_of('steer_in_effect_rad')} > 0.01")
    browser.wait_for(f"{value_of('lateral_error_m')} > 0.01")
    browser.wait_for(f"Math.abs({value_of('ghost_m')}) < 0.2")
    key(browser, "keyUp", "ArrowLeft")
    browser.wait_for(f"{value_of('steer_rad')} === 0")

    # The rim follows: above to the right is to the right.
    drag(browser, -0.2, -0.98, 0.2, SECOND_FINGER)
    browser.wait_for(f"Math.abs({value_of('steer_rad')} + 2 * Math.atan(0.2 / 0.98) / 16) < 0.002")
    let_go(browser)
    browser.wait_for(f"{value_of('steer_rad')} === 0")
    drag(browser, -0.2, 0.98, 0.2)
    browser.wait_for(f"{value_of('steer_rad')} > 0.01")
    let_go(browser)

    browser.read("navigator.getGamepads = () => [{ axes: [-0.5] }]; 0")
    browser.wait_for(f"{value_of('steer_rad')} > 0.05")
    browser.read("navigator.getGamepads = () => []; 0")
    browser.wait_for("/^5\\d s · RMS/.test(document.getElementById('score').textContent)")
    in_order(browser, live)


def test_a_lost_car_is_put_back_and_its_round_does_not_count(browser: Browser, live: str) -> None:
    browser.read("delete navigator.getGamepads")
    opened(browser, live)
    begin(browser, "Drive it: no delay")
    # The first key is told before there is a program to take it.
    browser.wait_for("!cockpit.lanes.length && cockpit.isDriven")
    assert "Press ←" in browser.read("document.getElementById('story').textContent")
    key(browser, "keyDown", "ArrowLeft")
    browser.wait_for("['3', '2', '1'].includes(document.getElementById('score').textContent)")
    assert not browser.read(f"Number.isFinite({value_of('steer_rad')})")  # the car waits as well
    browser.wait_for("cockpit.isInMetres && cockpit.lost[0]")
    story = "document.getElementById('story').textContent"
    browser.wait_for(f"/lost after [1-9]\\d* s; .* not count/.test({story})")
    key(browser, "keyUp", "ArrowLeft")
    browser.wait_for("document.getElementById('score').textContent === 'The car is ready'")
    browser.wait_for(f"{light('Steering')} === 'NO COMMAND'")  # it is sent none
    browser.wait_for(f"!cockpit.lost[0] && Math.abs({value_of('lateral_error_m')}) < 0.01")
    in_order(browser, live)


def test_a_car_is_driven_from_standstill_to_standstill(browser: Browser, live: str) -> None:
    pads = "[{ axes: [0], buttons: [0, 0, 0, 0, 0, 0, { value: 0 }, { value: 1 }] }]"
    opened(browser, live)
    begin(browser, "Drive a car: start to stop")
    browser.wait_for("cockpit.isDriven && cockpit.lanes.length")
    at_rest = browser.wait_for(value_of("front_load_share"))
    assert browser.read(value_of("speed_m_s")) == 0.0
    signals = ("speed_m_s", "rear_grip_used", "front_load_share")
    speed, grip, load = (value_of(name).replace("nowS", "nowS - k / 10") for name in signals)
    seen = f"[...Array(50).keys()].some((k) => {speed} > 6 && {grip} > 0.2 && {load} < {at_rest})"
    watch = f"setInterval(() => window.moved ||= {seen}, 100)"
    browser.read(f"navigator.getGamepads = () => {pads}; {watch}")
    browser.wait_for("window.moved")
    browser.read("delete navigator.getGamepads")
    for label in ("Speed", "Yaw rate", "Lateral", "Rack force", "Grip front", "Load rear"):
        assert label in browser.read("document.getElementById('gauges').innerText")
    browser.resize(390, 844, is_phone=True)
    assert browser.read("document.documentElement.scrollWidth") == 390
    browser.resize(1366, 768)
    bottom = "document.getElementById('felt-tools').getBoundingClientRect().bottom"
    assert browser.read(bottom) <= 768
    key(browser, "keyDown", "ArrowDown")
    browser.wait_for(f"{value_of('speed_m_s')} === 0")
    key(browser, "keyUp", "ArrowDown")
    browser.resize(1280, 720)
    in_order(browser, live)


FELT_PAD = """{
    window.felt = 0;
    const vibrationActuator = { playEffect: async () => void window.felt++ };
    navigator.getGamepads = () => [{ axes: [0.5], vibrationActuator }];
}"""


TOLD_OF_THE_WHEEL = """{
    let status = cockpit.status;
    window.told = "still";
    const lanes = () => status?.lanes?.map((lane) => ({ ...lane, hand_wheel: window.told }));
    void Object.defineProperty(cockpit, "status", {
        get: () => status && { ...status, lanes: lanes() }, set: (value) => (status = value),
    });
}"""
"""How the wheel moves is the machine's time; what is said of it is the page's."""


def test_the_moment_at_which_a_wheel_shakes_is_said(browser: Browser, live: str) -> None:
    opened(browser, live)
    begin(browser, "Feel it: hands off")
    browser.wait_for("cockpit.isDriven && cockpit.lanes.length")
    browser.read(FELT_PAD)
    browser.read(TOLD_OF_THE_WHEEL)
    said = "document.getElementById('felt').textContent"
    browser.wait_for(f"/still, .* force as it arrives$/.test({said})")
    browser.read("window.told = 'shakes at 0.5 Hz, ±2.3 rad'")
    moment = browser.wait_for(
        f"{said}.match(/begun to shake .* force as it arrives: since (\\d+) s/)"
    )
    assert 0 <= int(moment[1]) <= browser.read("cockpit.nowS")
    browser.wait_for("window.felt > 0")
    browser.read(press("with the CDOB"))
    browser.read("window.told = 'still'")
    browser.wait_for(f"/still, .* with the CDOB: again since/.test({said})")
    browser.read("delete navigator.getGamepads")
    in_order(browser, live)


def test_programs_and_record_are_seen_on_a_laptop(browser: Browser, live: str) -> None:
    opened(browser, live)
    begin(browser, "DDOB at 80 ms")
    browser.wait_for("cockpit.lanes.length === 1 && cockpit.status?.programs.length")
    for button in ("Kill plant of practical pd ddob", "Record every frame (R)"):
        box = f"document.querySelector('[title=\"{button}\"]')?.getBoundingClientRect()"
        assert browser.wait_for(f"{box}?.bottom") <= 720.0


def test_the_deviation_button_is_lit_only_where_it_magnifies(browser: Browser, replay: str) -> None:
    opened(browser, replay)
    lit = "document.getElementById('deviation').ariaPressed"
    said = "/\\d+/.exec(document.getElementById('deviation').textContent)[0]"
    for error_m, wanted in ((0.31, "false,1"), (0.29, "true,10")):
        browser.read(f"cockpit.lanes[0].columns.cg_deviation_m.fill({error_m}); cockpit.touch()")
        browser.wait_for(f"[{lit}, {said}].join() === {wanted!r}")
