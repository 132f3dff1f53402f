"""Whether a campaign shows what it is to show: a table of findings, each with its figure."""

from collections.abc import Sequence
from typing import NamedTuple

from tools.campaign.memory import GROWTH_BYTES_MAX, LONGER, Memory
from tools.campaign.residual import RESIDUAL, Residual, exceeds, falls_short
from tools.campaign.scenario import GOLDEN
from tools.campaign.specification import NodeFaultKind
from tools.campaign.trial import Result, Verdict


class Finding(NamedTuple):
    """One thing that was to be shown, whether it was, and the figure."""

    what: str
    holds: bool
    figure: str


def findings_of(results: Sequence[Result], ftti_ms: float) -> list[Finding]:
    """Return the findings of a campaign."""
    golden = [result for result in results if result.kind == GOLDEN]
    faulty = [result for result in results if result.kind != GOLDEN]
    alarms = [result for result in golden if result.verdict is Verdict.FALSE_ALARM]
    unsafe = [result for result in results if result.verdict is Verdict.UNSAFE]
    alarm_texts = f"{len(alarms)} of {len(golden)} golden runs counted anything"
    unsafe_texts = f"{len(unsafe)} of {len(results)} runs" + _first(unsafe)
    return [
        _detected(faulty, ftti_ms),
        Finding("no false detection in golden runs", not alarms, alarm_texts + _first(alarms)),
        Finding("no invalid or out-of-limit value sent by a node", not unsafe, unsafe_texts),
        _protected(results),
        _queues(results),
        _unheard(results),
    ]


def residual_finding(measured: Residual) -> Finding:
    """Return whether random errors fit the CRC as often as they should, and no less often."""
    is_too_many = exceeds(measured.fitting, measured.corrupted)
    is_too_few = falls_short(measured.fitting, measured.corrupted)
    figure = (
        f"{measured.fitting} of {measured.corrupted} frames with random errors in half of their "
        f"bits had a CRC that fits; expected are {measured.expected:.1f}"
    )
    what = "the CRC's residual probability is 2^-16"
    return Finding(what, not (is_too_many or is_too_few), figure)


def memory_finding(measured: Memory) -> Finding:
    """Return whether a pair with faults keeps nothing of each control period."""
    figure = (
        f"{measured.warm_bytes / 1e6:.2f} MB held after {measured.run_s / LONGER:g} s with faults, "
        f"{measured.late_bytes / 1e6:.2f} MB after {measured.run_s:g} s: "
        f"{measured.growth_bytes:.1f} bytes a control period, the smallest object takes "
        f"{GROWTH_BYTES_MAX:g}"
    )
    return Finding("no unbounded memory", measured.growth_bytes < GROWTH_BYTES_MAX, figure)


def _detected(faulty: Sequence[Result], ftti_ms: float) -> Finding:
    detectable = [
        result
        for result in faulty
        if result.expected != "none" and result.verdict is not Verdict.NO_EFFECT
    ]
    missed = [result for result in detectable if result.verdict in (Verdict.MISSED, Verdict.LATE)]
    slowest_s = max((one.fhti_s for one in detectable if one.fhti_s is not None), default=0.0)
    figure = (
        f"{len(detectable) - len(missed)} of {len(detectable)}, "
        f"slowest FHTI {1e3 * slowest_s:.1f} ms"
    )
    what = f"every detectable fault handled within {ftti_ms:g} ms"
    return Finding(what, not missed, figure + _first(missed))


def _protected(results: Sequence[Result]) -> Finding:
    corrupted = sum(result.corrupted for result in results)
    accepted = sum(result.corrupted_accepted for result in results)
    figure = (
        f"{accepted} of {corrupted} corrupted frames accepted; the CRC's residual probability "
        f"2^-16 lets {corrupted * RESIDUAL:.2g} be expected"
    )
    what = "no frame accepted that fails its protection"
    return Finding(what, not exceeds(accepted, corrupted), figure)


def _queues(results: Sequence[Result]) -> Finding:
    """Every queue of a node refuses what is too much; only a bus that is full makes one fill."""
    filled = [
        result
        for result in results
        if result.bus_refused and result.kind != NodeFaultKind.BABBLING.value
    ]
    refused = sum(result.bus_refused for result in results)
    figure = f"{refused} frames found their queue of 64 full, all behind a babbling node"
    if filled:
        figure = f"queues filled without a babbling node in {len(filled)} runs" + _first(filled)
    return Finding("no unbounded queue", not filled, figure)


def _unheard(results: Sequence[Result]) -> Finding:
    unheard = [result for result in results if result.as_golden is not None]
    disturbed = [result for result in unheard if result.verdict is Verdict.DISTURBED]
    figure = (
        f"{len(unheard) - len(disturbed)} of {len(unheard)} runs are the golden one bit for bit, "
        f"and nothing counted" + _first(disturbed)
    )
    return Finding("faults where no node listens change nothing", not disturbed, figure)


def _first(results: Sequence[Result]) -> str:
    """Name the first of runs that should not be."""
    if not results:
        return ""
    one = results[0]
    return f"; first: {one.name} ({one.verdict}{': ' + one.unsafe[:80] if one.unsafe else ''})"
