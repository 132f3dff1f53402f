"""What a campaign must show: its findings, each with its figure.

E2E profile 5 has a CRC of 16 bits: of frames with random errors in more than three bits, one in
65536 has a CRC that fits. A range, a value table or a counter rejects some of these too, so

    accepted ≤ corrupted · 2^-16

is the bound in a run.
"""

from collections.abc import Iterable, Sequence

from ....closed_loop.reports.findings import Finding
from .campaign_file import NodeFaultKind
from .campaign_runs import GOLDEN
from .virtual_trial import Detection, RunResult

RESIDUAL = 2.0**-16
IMPROBABLE = 1e-4


def exceeds(accepted: int, corrupted: int) -> bool:
    """Whether too many were accepted for the CRC's residual probability to explain it."""
    from scipy.special import pdtrc

    return accepted > 0 and float(pdtrc(accepted - 1, corrupted * RESIDUAL)) < IMPROBABLE


_IDLE = (Detection.NO_EFFECT, Detection.NO_CHANCE)


def findings_of(results: Sequence[RunResult], ftti_ms: float) -> list[Finding]:
    """Return the findings of a campaign.

    Without a golden run, or without a detectable fault, no finding holds that needs one.
    """
    golden = [result for result in results if result.kind == GOLDEN]
    faulty = [result for result in results if result.kind != GOLDEN]
    return [
        *_handled(faulty, ftti_ms),
        _effective(faulty),
        _recovered(faulty),
        _smooth(faulty),
        _unalarmed(golden, faulty),
        _valid(results),
        _protected(results),
        _queues(results),
        _unreceived(results),
    ]


def _handled(faulty: Sequence[RunResult], ftti_ms: float) -> list[Finding]:
    """Detectable faults are detected; their frames are rejected; control is left where required."""
    seen = [one for one in faulty if one.expected != "none" and one.verdict not in _IDLE]
    late = [one for one in seen if one.fdti_s is None or not 0.0 <= one.fdti_s <= 1e-3 * ftti_ms]
    leaving = [one for one in seen if one.safe_state]
    stayed = [one for one in leaving if one.fhti_s is None or one.fhti_s > 1e-3 * ftti_ms]
    falsified = [one for one in seen if one.false_frames]
    believed = [one for one in falsified if one.verdict is Detection.BELIEVED]
    followed = [one for one in falsified if one.verdict is Detection.FOLLOWED]
    kinds = ", ".join(dict.fromkeys(one.kind for one in followed)) or "none"
    after = sum(one.false_after for one in followed)
    frames = sum(one.false_frames for one in followed)
    share = f", with {100.0 * after / frames:.0f} % of their false frames" if frames else ""
    return [
        Finding(
            f"every detectable fault detected within {ftti_ms:g} ms, and none before its onset",
            bool(seen) and not late,
            f"{len(seen) - len(late)} of {len(seen)}, slowest FDTI "
            f"{_slowest_ms(one.fdti_s for one in seen)}{_first(late)}",
        ),
        Finding(
            f"control left within {ftti_ms:g} ms where nothing is left to act on",
            not stayed if leaving else None,
            f"{len(leaving) - len(stayed)} of {len(leaving)}, slowest FHTI "
            f"{_slowest_ms(one.fhti_s for one in leaving)}{_first(stayed)}",
        ),
        Finding(
            "false frames refused once detected, where anything distinguishes them from true ones",
            not believed if falsified else None,
            f"{len(falsified) - len(followed) - len(believed)} of {len(falsified)} runs; "
            f"{len(followed)} followed, as was to be expected ({kinds}){share}{_first(believed)}",
        ),
    ]


def _effective(faulty: Sequence[RunResult]) -> Finding:
    idle = [one for one in faulty if one.verdict is Detection.NO_EFFECT]
    spared = [one for one in faulty if one.verdict is Detection.NO_CHANCE]
    kinds = ", ".join(dict.fromkeys(one.label for one in spared))
    note = f"; {len(spared)} by chance without ({kinds})" if spared else ""
    figure = f"{len(faulty) - len(idle) - len(spared)} of {len(faulty)} runs{note}{_first(idle)}"
    return Finding("every fault had an effect", bool(faulty) and not idle, figure)


def _recovered(faulty: Sequence[RunResult]) -> Finding:
    running = [one for one in faulty if one.verdict not in _IDLE]
    asked = [one for one in running if one.recovery_allowed_s is not None]
    missing = [one for one in asked if not one.is_back]
    allowed_s = [one.recovery_allowed_s or 0.0 for one in asked]
    least, most = min(allowed_s, default=0.0), max(allowed_s, default=0.0)
    figure = (
        f"{len(asked) - len(missing)} of {len(asked)}, slowest "
        f"{_slowest_ms(one.recovery_s for one in asked)}; allowed are {1e3 * least:.0f} to "
        f"{1e3 * most:.0f} ms, by the latency{_first(missing)}"
    )
    what = "both nodes in control again after the fault, unless a peer is dead"
    return Finding(what, not missing if asked else None, figure)


def _smooth(faulty: Sequence[RunResult]) -> Finding:
    """Command and wheel do not jump when a node recovers."""
    command = [one.command_return_rad for one in faulty if one.command_return_rad is not None]
    wheel = [one.wheel_return_rad for one in faulty if one.wheel_return_rad is not None]
    jumped = [one for one in faulty if one.jumps]
    figure = (
        f"{len(command)} runs with a return of the controller, {len(wheel)} of the steering; "
        f"largest step of the command then {max(command, default=0.0):.5f} rad, of the wheel "
        f"{max(wheel, default=0.0):.5f} rad, apart from what commands that come together cause"
    )
    if jumped:
        figure += f"; {len(jumped)} runs jump{_first(jumped)}: {jumped[0].jumps}"
    what = "no step on the way back beyond what fades and limits allow"
    return Finding(what, not jumped if command or wheel else None, figure)


def _unalarmed(golden: Sequence[RunResult], faulty: Sequence[RunResult]) -> Finding:
    alarms = [one for one in golden if one.verdict is Detection.FALSE_ALARM]
    early = [one for one in faulty if one.verdict is Detection.EARLY]
    figure = f"{len(alarms)} of {len(golden)} golden runs counted anything{_first(alarms + early)}"
    holds = bool(golden) and not alarms and not early
    return Finding("no false detection in golden runs", holds, figure)


def _valid(results: Sequence[RunResult]) -> Finding:
    unsafe = [one for one in results if one.verdict is Detection.UNSAFE]
    figure = f"{len(unsafe)} of {len(results)} runs{_first(unsafe)}"
    what = "no invalid or out-of-limit value sent by a node"
    return Finding(what, bool(results) and not unsafe, figure)


def _protected(results: Sequence[RunResult]) -> Finding:
    corrupted = sum(result.corrupted for result in results)
    accepted = sum(result.corrupted_accepted for result in results)
    figure = (
        f"{accepted} of {corrupted} corrupted frames accepted; the CRC's residual probability "
        f"2^-16 lets {corrupted * RESIDUAL:.2g} be expected"
    )
    what = "no frame accepted that fails its protection"
    return Finding(what, not exceeds(accepted, corrupted) if corrupted else None, figure)


def _queues(results: Sequence[RunResult]) -> Finding:
    """Every queue of a node rejects what exceeds its size; only a full bus fills one."""
    filled = [one for one in results if one.bus_refused and one.kind != NodeFaultKind.BABBLING]
    refused = sum(result.bus_refused for result in results)
    figure = f"{refused} frames found their queue of 64 full, all behind a babbling node"
    if filled:
        figure = f"queues filled without a babbling node in {len(filled)} runs" + _first(filled)
    return Finding("no unbounded queue", bool(results) and not filled, figure)


def _unreceived(results: Sequence[RunResult]) -> Finding:
    checked = [result for result in results if result.as_golden is not None]
    disturbed = [result for result in checked if result.verdict is Detection.DISTURBED]
    figure = (
        f"{len(checked) - len(disturbed)} of {len(checked)} runs are the golden one bit for bit, "
        f"and nothing counted" + _first(disturbed)
    )
    what = "faults where no node listens change nothing"
    return Finding(what, not disturbed if checked else None, figure)


def _slowest_ms(times_s: Iterable[float | None]) -> str:
    known = [time_s for time_s in times_s if time_s is not None]
    return f"{1e3 * max(known):.1f} ms" if known else "none"


def _first(results: Sequence[RunResult]) -> str:
    """Name the first of the results that should not occur."""
    if not results:
        return ""
    one = results[0]
    return f"; first: {one.name} ({one.verdict}{': ' + one.unsafe[:80] if one.unsafe else ''})"
