"""Fixtures for tests of CAN programs and of steering controllers; pytest loads this by itself.

    can_bus    vcan0 where this machine has it, else an emulated bus, with the reason in the report
    rig        a plant with vehicle, path, network, faults and seed: ``rig.run(controller)``
    recording  every frame on ``can_bus`` during the test, as ``candump -L`` prints it

    @pytest.mark.steer_by_wire(plant="paper_nominal", latency_s=0.08, seeds=range(3))
    def test_my_controller_holds_the_path(rig):
        rig.run(["./my_controller", "{channel}"]).assert_holds(settled_rms_m=0.02)

Arguments of the marker: ``plant`` (a preset, or a settings file), ``latency_s`` (mean latency of
the commands), ``seeds`` (the test runs once with each), ``overrides`` (other settings of the plant,
by ``table.key``), ``bus`` (auto, socketcan or emulated) and ``dialect`` (the file of a car). For a
failed test the report names log, picture and seed; JUnit XML has seed and folder as properties.
"""

from collections.abc import Generator, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from ..runtime.command_line import installation

if TYPE_CHECKING:
    from .pair.live_bus import Bus
    from .rig import Rig

MARKER = "steer_by_wire"
ARGUMENTS = ("plant", "latency_s", "seeds", "overrides", "bus", "dialect")


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line(
        "markers",
        f"{MARKER}({', '.join(ARGUMENTS)}): the plant, network and seeds of the fixture rig",
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test with a rig once for each of its seeds."""
    marker = metafunc.definition.get_closest_marker(MARKER)
    if "rig" in metafunc.fixturenames and marker is not None and "seeds" in marker.kwargs:
        seeds = marker.kwargs["seeds"]
        if not isinstance(seeds, Iterable) or not (seeds := [*seeds]):
            pytest.fail(f"marker {MARKER}: seeds = {seeds!r} should be a list, as [1, 2]", False)
        metafunc.parametrize("rig", seeds, indirect=True, ids=[f"seed{s}" for s in seeds])


@pytest.fixture
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> "Rig":
    """A plant to drive; the marker ``steer_by_wire`` sets it up."""
    from ..runtime.settings import SettingsError
    from .rig import Rig

    marker = request.node.get_closest_marker(MARKER)
    given: dict[str, Any] = dict(marker.kwargs) if marker is not None else {}
    unknown = [name for name in given if name not in ARGUMENTS]
    if unknown or (marker is not None and marker.args):
        wrong = ", ".join(unknown) or "positional arguments"
        pytest.fail(f"marker {MARKER} takes {', '.join(ARGUMENTS)} by name, not {wrong}", False)
    overrides = dict(given.get("overrides", {}))
    if "latency_s" in given:
        overrides["latency.downlink.mean_s"] = given["latency_s"]
    try:
        made = Rig(
            tmp_path,
            given.get("plant", "paper_nominal"),
            overrides,
            getattr(request, "param", None),
            given.get("bus", "auto"),
            given.get("dialect"),
        )
    except SettingsError as error:
        raise pytest.fail.Exception(str(error), pytrace=False) from None
    request.node.stash[_RIG] = made
    return made


@pytest.fixture
def can_bus(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator["Bus"]:
    """vcan0, or a bus of this test's own: its interface, its channel and ``open()``."""
    from .pair.live_bus import open_channels

    with open_channels("auto", ["can"], tmp_path / "bus.txt") as channels:
        request.node.user_properties.append(("can_bus", channels.description))
        yield channels.buses[0]


@pytest.fixture
def recording(can_bus: "Bus", tmp_path: Path) -> Iterator[Path]:
    """A file that gets every frame on ``can_bus`` during the test."""
    from .pair.bus_recorder import BusRecorder

    file = tmp_path / "candump.log"
    with BusRecorder(can_bus, file) as recorder:
        yield file
    if recorder.failure:
        pytest.fail(f"the recording was cut off: {recorder.failure}", pytrace=False)


_RIG = pytest.StashKey["Rig"]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: "pytest.CallInfo[None]"
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Name the files of a failed test's runs."""
    report = yield
    made = item.stash.get(_RIG, None)
    if call.when == "call" and made is not None:
        for outcome in made.outcomes:
            folder = str(outcome.files.folder)
            item.user_properties += [("seed", outcome.settings.seed), ("run", folder)]
            if report.failed:
                lines = [
                    f"bus      {outcome.bus}",
                    f"seed     {outcome.settings.seed}",
                    f"log      {outcome.files.candump_log}",
                    f"picture  {_picture(outcome)}",
                ]
                report.sections.append((f"steer-by-wire {folder}", "\n".join(lines)))
    return report


def _picture(outcome: Any) -> str:
    try:
        return str(outcome.draw())
    except ImportError as error:
        return f"none: {installation(str(error.name))}"
