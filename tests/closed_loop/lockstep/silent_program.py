"""A program that answers each record of the lockstep protocol, and never sends a frame."""

import sys

from steer_by_wire.closed_loop.lockstep.record import RECORD_BYTES, Record, pack, unpack

PERIOD_NS = 10_000_000

if __name__ == "__main__":
    while data := sys.stdin.buffer.read(RECORD_BYTES):
        now_ns = unpack(data)[1]
        sys.stdout.buffer.write(pack(Record(0, now_ns + PERIOD_NS)))
        sys.stdout.buffer.flush()
