"""Smith predictor and feed-forward: compiled runs, presets, settings and words."""

import math
import re
from collections.abc import Sequence
from itertools import product

import pytest

from steer_by_wire.closed_loop.compiled.engine import Outcome, rms_of, run_compiled
from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.analysis.stable_delays import stable_delays
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import controller_preset as preset
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.settings import SettingsError, read_preset
from tests.support.loops.baseline_runs import FEED_FORWARD, vehicle_of
from tests.support.runs.compiled_runs import NETWORKS, assert_same_as_nodes
from tests.support.runs.compiled_runs import plant_settings as rig
from tests.support.suite.no_jitter import no_jitter as no_jitter

PERIOD_NS, PERIOD_S = 10_000_000, 0.01
ELLIPSE = ('path={kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}',)


# Compiled runs


@pytest.mark.parametrize(
    ("name", "overrides", "network"),
    [
        *product(("practical_smith",), ((),), ("off the grid", "as it arrives", "schedule")),
        *product(("practical_smith", "practical_pd_ddob"), (FEED_FORWARD,), ("as it arrives",)),
    ],
)
def test_a_compiled_run_equals_the_nodes(name: str, overrides: Sequence[str], network: str) -> None:
    latency = [f"latency.{override}" for override in NETWORKS[network]]
    run = assert_same_as_nodes(rig([*ELLIPSE, *latency], 4.0), preset(name, overrides))
    assert len(run.tick_s) > 300


# Presets


def corner(name: str, delay_ms: int) -> PlantSettings:
    overrides = ["duration_s=60", *ELLIPSE, f"latency.downlink.mean_s={delay_ms * 1e-3}"]
    return plant_preset(f"paper_corner_{name}", overrides)


@pytest.mark.parametrize("law", ["smith", "pid"])
def test_a_preset_keeps_the_error_its_file_states(law: str) -> None:
    name = f"practical_{law}"
    text = read_preset("steer_by_wire.controller.presets", name).text
    stated = re.search(r"# +RMS error +([\d.]+) m at 0 ms, ([\d.]+) m at 250 ms, from 5 s on", text)
    assert stated
    for delay_ms, rms_m in zip((0, 250), map(float, stated.groups()), strict=True):
        runs = [run_compiled(corner(each, delay_ms), preset(name)) for each in "abcd"]
        assert {run.outcome for run in runs} == {Outcome.COMPLETE}
        worst_m = max(rms_of(run.cg_deviation_m[run.time_s >= 5.0]) for run in runs)
        assert worst_m == pytest.approx(rms_m, rel=0.01)


def test_the_smith_preset_is_stable_as_far_as_its_file_states() -> None:
    settings = preset("practical_smith", ("followed_point=preview",))
    text = read_preset("steer_by_wire.controller.presets", "practical_smith").text
    stated = re.search(r"# +stable +up to (\d+) ms", text)
    assert stated
    ends = []
    for each in "abcd":
        vehicle = corner(each, 0).vehicle
        values = {"speed_m_s": vehicle.speed_m_s, "virtual_mass_kg": vehicle.virtual_mass_kg}
        model = vehicle_of(settings).model_copy(update=values).model
        ((first_ns, last_ns),) = stable_delays(SampledLoop(design_law(settings), model, PERIOD_NS))
        assert first_ns == 0
        ends.append(last_ns)
    assert math.floor(min(ends) / 1e6) == int(stated[1])


# Settings and words


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (('law="smith"',), r"law = 'smith' needs the table \[smith\]"),
        (("smith={delay_s=-0.1}",), "smith.delay_s"),
        (("smith={delay_s=2.5}",), "smith.delay_s"),
        (("smith={delay_s=0.1, washout_rad_s=400}",), "must be below pi"),
        (("feed_forward={gain=3}",), "feed_forward.gain"),
        (('nominal_model={kind="paper_eq19"}', *FEED_FORWARD), "needs nominal_model.kind"),
    ],
)
def test_settings_without_sense_are_refused(overrides: Sequence[str], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        preset("practical_pd", overrides)


def test_the_predictor_takes_no_feed_forward() -> None:
    overrides = ('law="predictor"', "predictor={}", *FEED_FORWARD)
    with pytest.raises(SettingsError, match="steers for the curvature that it estimates"):
        preset("practical_pd_ddob", overrides)
