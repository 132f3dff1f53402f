"""Smith predictor and feed-forward: what a preset states, and the settings that are refused."""

import re
from collections.abc import Sequence

import pytest

from steer_by_wire.closed_loop.compiled.engine import Outcome, run_compiled
from steer_by_wire.closed_loop.compiled.loop_records import rms_of
from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.analysis.stable_delays import least_margin_ns
from steer_by_wire.controller.filters.nominal_model import steer_to_lateral_error
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import controller_preset as preset
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.settings import SettingsError, read_preset
from steer_by_wire.tools.paper.corners import corner_vehicles
from tests.support.loops.baseline_runs import FEED_FORWARD

PERIOD_NS = 10_000_000
ELLIPSE = ('path={kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}',)


# Presets


def test_the_smith_preset_keeps_what_its_file_states() -> None:
    text = read_preset("steer_by_wire.controller.presets", "practical_smith").text
    stated = re.search(r"# +RMS error +([\d.]+) m at 0 ms, ([\d.]+) m at 250 ms, from 5 s on", text)
    assert stated
    for delay_ms, rms_m in zip((0, 250), map(float, stated.groups()), strict=True):
        driven = ["duration_s=60", *ELLIPSE, f"latency.downlink.mean_s={delay_ms * 1e-3}"]
        corners = [plant_preset(f"paper_corner_{name}", driven) for name in "abcd"]
        runs = [run_compiled(corner, preset("practical_smith")) for corner in corners]
        assert {run.outcome for run in runs} == {Outcome.COMPLETE}
        worst_m = max(rms_of(run.cg_deviation_m[run.time_s >= 5.0]) for run in runs)
        assert worst_m == pytest.approx(rms_m, rel=0.01)
    stable = re.search(r"# +stable +up to (\d+) ms", text)
    assert stable
    design = design_law(preset("practical_smith", ("followed_point=preview",)))
    models = map(steer_to_lateral_error, corner_vehicles())
    margin_ns = least_margin_ns(SampledLoop(design, model, PERIOD_NS) for model in models)
    assert margin_ns // 1_000_000 == int(stable[1])


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
        (('law="predictor"', "predictor={}", *FEED_FORWARD), "curvature that it estimates"),
    ],
)
def test_settings_without_sense_are_refused(overrides: Sequence[str], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        preset("practical_pd_ddob", overrides)
