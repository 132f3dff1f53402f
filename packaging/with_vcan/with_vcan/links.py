"""Makes network interfaces with few processes, which start slowly in a User Mode Linux."""

import subprocess
from collections.abc import Sequence
from itertools import groupby


class LinkError(Exception):
    """One of the commands has failed; ``complaint`` is the first line of what its program says."""

    def __init__(self, command: Sequence[str], complaint: str) -> None:
        super().__init__(f"{' '.join(command)}: {complaint}")
        self.command, self.complaint = command, complaint


def make_links(commands: Sequence[Sequence[str]], path: str) -> None:
    """Run commands of ip and tc, programs on ``path``; raises LinkError."""
    for program, group in groupby(commands, lambda command: command[0]):
        batch = list(group)
        done = subprocess.run(
            [program, "-batch", "-"],
            input="".join(f"{' '.join(command[1:])}\n" for command in batch),
            capture_output=True,
            text=True,
            check=False,
            env={"PATH": path, "LC_ALL": "C"},
        )
        if done.returncode:
            said = done.stderr.strip().splitlines() or ["no reason given"]  # then tc's usage
            number = done.stderr.rpartition("Command failed -:")[2].strip()
            failed = batch[int(number) - 1] if number.isdecimal() else batch[0]
            raise LinkError(failed, said[0])
