"""python-can's writers of recordings, and how many frames have reached the file."""

from pathlib import Path

import can
from can.io.generic import MessageWriter, TextIOMessageWriter


class BlfWriter(can.BLFWriter):
    """python-can's writer, which buffers 128 KiB, and writes the start time only at the end.

    ``frames_in_file``  number of objects in the file at its last update
    """

    frames_in_file = 0

    def bring_up_to_date(self) -> None:
        """Write all buffered frames, and a header with their number and the start time."""
        self._flush()
        if self.file.seekable():
            end = self.file.tell()
            self.file.seek(0)
            self._write_header(end)
            self.file.seek(end)
        self.file.flush()
        self.frames_in_file = self.object_count


def open_writer(path: Path) -> MessageWriter:
    """Open ``path`` in the format of its suffix; raises what the writer raises."""
    return BlfWriter(path) if path.suffix.lower() == ".blf" else can.Logger(path)


def frames_in_file(writer: MessageWriter, given: int) -> int:
    """Return how many of ``given`` frames would be in the file if the writer were killed now."""
    if isinstance(writer, TextIOMessageWriter):
        return given
    if isinstance(writer, BlfWriter):
        return writer.frames_in_file
    return writer.num_frames if isinstance(writer, can.SqliteWriter) else 0
