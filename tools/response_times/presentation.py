"""The figures as a table, as text and as JSON."""

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from ...terminal import plain_table
from .message_set import BusSettings
from .responses import RANDOM_NS, RANDOM_RUNS, Response
from .steering import Steering, Tolerance


def response_table(responses: Sequence[Response], bus: BusSettings) -> Table:
    """Return one row a message, highest priority first."""
    title = f"response times [ms] at {bus.bitrate_bit_s / 1000:g} kbit/s"
    numbers = ("bytes", "period", "frame", "bound", "worst case", "random", "deadline")
    table = plain_table(("message", "identifier"), numbers, title)
    table.caption = (
        "bound: any payload and phases. worst case: the bus model at the critical instant, "
        f"with the longest payloads found. random: {RANDOM_RUNS} runs of {RANDOM_NS / 1e9:g} s "
        "with random phases. deadline: the period; a figure is the chance of a miss, at most."
    )
    for response in responses:
        bound = response.message.bound
        frame = response.message.frame
        width = 8 if frame.flags & 1 else 3
        table.add_row(
            bound.name, f"0x{frame.can_id:0{width}X}", str(len(frame.data)),
            f"{bound.period_ns / 1e6:g}", _ms(bound.frame_ns), _ms(response.bound_ns),
            _ms(response.critical_ns), _ms(response.random_ns), _verdict(response),
        )  # fmt: skip
    return table


def steering_text(steering: Steering) -> str:
    """Return what the bus adds to the steering's delay, and what each law tolerates."""
    most = "without bound" if steering.most_ns is None else f"at most {_ms(steering.most_ns)} ms"
    lines = [
        f"bus load: {100 * steering.load:.1f} %",
        f"LATERAL_ERROR and STEERING_COMMAND together: {_ms(steering.least_ns)} ms on a free bus, "
        f"{most}",
        "Constant delay that the loop of each law tolerates, and the load by more urgent messages "
        "(sent more and more often) at which the bus alone reaches it:",
    ]
    width = max(len(tolerance.preset) for tolerance in steering.tolerances)
    return "\n".join([*lines, *(_tolerance(t, width) for t in steering.tolerances)])


def record_of(
    responses: Sequence[Response], bus: BusSettings, steering: Steering | None, seed: int
) -> dict[str, Any]:
    """Return everything, for another program; times in nanoseconds."""
    return {
        "bus": bus._asdict(),
        "seed": seed,
        "messages": [
            {
                **response.message.bound._asdict(),
                "mean_period_ns": response.message.mean_period_ns,
                "can_id": response.message.frame.can_id,
                "longest_payload": response.message.frame.data.hex(),
                "longest_found_ns": response.message.found.frame_ns,
                "bound_ns": response.bound_ns,
                "critical_ns": response.critical_ns,
                "random_ns": response.random_ns,
                "miss_probability": response.miss,
            }
            for response in responses
        ],
        "steering": None
        if steering is None
        else steering._asdict() | {"tolerances": [t._asdict() for t in steering.tolerances]},
    }


def _tolerance(tolerance: Tolerance, width: int) -> str:
    if tolerance.margin_ns == 0:
        return f"  {tolerance.preset:{width}}  not stable, even without delay"
    if tolerance.margin_ns is None:
        margin = "any delay that was tried"
    else:
        margin = f"{tolerance.margin_ns / 1e6:6.1f} ms"
    at = "no load" if tolerance.load_max is None else f"{100 * tolerance.load_max:.1f} % load"
    return f"  {tolerance.preset:{width}}  {margin}, reached at {at}"


def _verdict(response: Response) -> str:
    if response.bound_ns is None:
        return "no bound"
    if response.bound_ns > response.message.bound.period_ns:
        return "MISSED"
    if response.miss is None:
        return "met"
    # Below that it is what rounding leaves of 1.
    return "met, < 1e-12" if response.miss < 1e-12 else f"met, {response.miss:.1e}"


def _ms(time_ns: int | None) -> str:
    return "-" if time_ns is None else f"{time_ns / 1e6:.3f}"
