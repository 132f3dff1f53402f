"""A controller written from the DBC alone, on cantools and python-can
===================================================================

It uses none of this project's code. It answers every LATERAL_ERROR with a STEERING_COMMAND: PD with
a filtered derivative.

::

    steer-by-wire plant -i socketcan -c vcan0 --set duration_s=20
    python examples/foreign_controller.py dbc/steer_by_wire.dbc -i socketcan -c vcan0

In virtual time it speaks the lockstep protocol instead:

    steer-by-wire run --controller-command \
        'python examples/foreign_controller.py dbc/steer_by_wire.dbc --lockstep'
"""

import argparse
import struct
import sys
import time
from pathlib import Path
from typing import Any

import can.cli
import cantools
from matplotlib.figure import Figure

GAIN_RAD_M, DERIVATIVE_RAD_S_M, FILTER_RAD_S, PERIOD_S = 1.5, 0.07, 25.0, 0.01
STEER_RAD_MAX, MODE_ACTIVE = 0.6, 1
HEAD, FRAME = struct.Struct("<4sHHq"), struct.Struct("<qIBB2x64s")
FRAMES_MAX, WAKE_ON_FRAMES, NEVER_NS = 16, 1, 2**63 - 1
SILENCE_S, PATIENCE_S = 2.0, 60.0


def crc16(data: bytes | bytearray) -> int:
    """Return the CRC of AUTOSAR E2E profile 5: polynomial 0x1021, start 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


class ForeignController:
    def __init__(self, dbc: Path) -> None:
        database: Any = cantools.database.load_file(dbc)
        self.error, self.command = (
            database.get_message_by_name(name) for name in ("LATERAL_ERROR", "STEERING_COMMAND")
        )
        self.errors_m: list[float] = []
        self.counter = -1
        self.derivative_m_s, self.sent = 0.0, 0

    def on_message(self, message: can.Message) -> can.Message | None:
        """Return the answer to a measurement, None to all else."""
        if message.arbitration_id != self.error.frame_id or not self.is_intact(message.data):
            return None
        decoded: Any = self.error.decode(bytes(message.data))
        error_m, counter = (
            decoded[f"LATERAL_ERROR_{name}"] for name in ("LATERAL_ERROR", "COUNTER")
        )
        # NOT_AVAILABLE is a word; a counter that does not step is a repetition.
        if not isinstance(error_m, float) or counter == self.counter:
            return None
        self.counter = counter
        change_m = error_m - (self.errors_m[-1] if self.errors_m else error_m)
        decay = 1.0 / (1.0 + FILTER_RAD_S * PERIOD_S)
        self.derivative_m_s = decay * (self.derivative_m_s + FILTER_RAD_S * change_m)
        self.errors_m.append(error_m)
        steer_rad = -GAIN_RAD_M * error_m - DERIVATIVE_RAD_S_M * self.derivative_m_s
        return self.steer(min(max(steer_rad, -STEER_RAD_MAX), STEER_RAD_MAX))

    def steer(self, steer_rad: float) -> can.Message:
        values = {
            "STEERING_COMMAND_CRC": 0,
            "STEERING_COMMAND_COUNTER": self.sent % 256,
            "STEER": steer_rad,
            "COMMAND_COUNTER": self.sent % 65536,
            "STEERING_COMMAND_MODE": MODE_ACTIVE,
        }
        data = bytearray(self.command.encode(values))
        data[:2] = crc16(data[2:] + data_id(self.command)).to_bytes(2, "little")
        self.sent += 1
        return can.Message(arbitration_id=self.command.frame_id, data=data, is_extended_id=False)

    def is_intact(self, data: bytearray) -> bool:
        crc = crc16(data[2:] + data_id(self.error))
        return len(data) == self.error.length and crc == int.from_bytes(data[:2], "little")


def data_id(message: cantools.database.can.Message) -> bytes:
    """Return the Data ID, which the CRC covers and no frame carries."""
    specifics: Any = message.dbc
    return int(specifics.attributes["E2EDataId"].value).to_bytes(2, "little")


def run_in_lockstep(controller: ForeignController) -> None:
    """Answer each record on standard input by one on standard output."""
    size = HEAD.size + FRAMES_MAX * FRAME.size
    while len(record := sys.stdin.buffer.read(size)) == size:
        mark, _why, count, _now_ns = HEAD.unpack_from(record)
        answers = b""
        for index in range(count):
            arrived = FRAME.unpack_from(record, HEAD.size + index * FRAME.size)
            time_ns, can_id, length, _format, data = arrived
            message = can.Message(1e-9 * time_ns, can_id, data=data[:length])
            if answer := controller.on_message(message):
                answers += FRAME.pack(0, answer.arbitration_id, answer.dlc, 0, answer.data)
        head = HEAD.pack(mark, WAKE_ON_FRAMES, len(answers) // FRAME.size, NEVER_NS)
        sys.stdout.buffer.write((head + answers).ljust(size, b"\0"))
        sys.stdout.buffer.flush()


def draw(controller: ForeignController, file: Path) -> None:
    figure = Figure(figsize=(8.0, 3.5), layout="constrained", dpi=110)
    axes = figure.subplots()
    time_s = [PERIOD_S * number for number in range(len(controller.errors_m))]
    axes.plot(time_s, [1e3 * error_m for error_m in controller.errors_m])
    axes.set(xlabel="time [s]", ylabel="lateral error [mm]", title="From the DBC alone")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dbc", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/examples"))
    parser.add_argument("--lockstep", action="store_true")
    can.cli.add_bus_arguments(parser)
    options = parser.parse_args()
    controller = ForeignController(options.dbc)
    if options.lockstep:
        run_in_lockstep(controller)
        return
    with can.cli.create_bus_from_namespace(options) as bus:
        print("ready", flush=True)
        until_s = time.monotonic() + PATIENCE_S
        while (left_s := until_s - time.monotonic()) > 0.0:
            message = bus.recv(left_s)
            if message is not None and (answer := controller.on_message(message)) is not None:
                bus.send(answer)
                until_s = time.monotonic() + SILENCE_S  # the plant has ended when it falls silent
    draw(controller, options.out / "foreign_controller.png")
    print(f"{controller.sent} commands sent")


if __name__ == "__main__":
    main()
