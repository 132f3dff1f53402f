"""python-can's writers of recordings, and how much of what they were given is in the file."""

from pathlib import Path

import can
from can.io.generic import MessageWriter, TextIOMessageWriter


class BlfWriter(can.BLFWriter):
    """python-can's, which alone keeps 128 KiB to itself, and the time of the start until the end.

    ``frames_in_file``  objects that were in the file when it was last brought up to date
    """

    frames_in_file = 0

    def bring_up_to_date(self) -> None:
        """Write what has arrived, and a header with its count and the time of the start."""
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
    """Return how many of ``given`` frames are in the file, should nothing more be written."""
    if isinstance(writer, TextIOMessageWriter):
        return given
    if isinstance(writer, BlfWriter):
        return writer.frames_in_file
    return writer.num_frames if isinstance(writer, can.SqliteWriter) else 0
