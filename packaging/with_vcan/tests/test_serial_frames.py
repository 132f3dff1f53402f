"""Frames on the serial lines of a User Mode Linux: they survive any cut of the stream."""

from steer_by_wire.with_vcan.serial_frames import Kind, LineFrame, Unpacker, pack


def test_frames_are_put_together_from_any_pieces() -> None:
    sent = [
        LineFrame(Kind.STDOUT, b"x" * 300),
        LineFrame(Kind.READY, b""),
        LineFrame(Kind.STATUS, b"7"),
    ]
    wire = b"".join(pack(*frame) for frame in sent)
    for size in (1, 2, 7, len(wire)):
        unpacker = Unpacker()
        pieces = [wire[start : start + size] for start in range(0, len(wire), size)]
        assert [frame for piece in pieces for frame in unpacker.feed(piece)] == sent
