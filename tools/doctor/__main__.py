"""Check what this machine has for CAN and real time, and advise how to get what it lacks.

    steer-by-wire doctor [--json]

Exit status 0 whatever it finds: a machine without CAN is no mistake.
"""

import json
import sys
from collections.abc import Sequence

from steer_by_wire.command_line import command_parser
from steer_by_wire.runtime.program import ExitStatus, run_main
from steer_by_wire.tools.doctor.checks import Section, examine

NAME = "steer-by-wire doctor"


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine and print; returns the exit status."""
    return run_main(NAME, lambda: _examine(arguments))


def _examine(arguments: Sequence[str] | None) -> ExitStatus:
    parser = command_parser(NAME, __doc__, NAME)
    parser.add_argument("--json", action="store_true", help="print JSON for other programs")
    options = parser.parse_args(arguments)
    sections = examine()
    print(as_json(sections) if options.json else as_text(sections))
    return ExitStatus.OK


def as_json(sections: Sequence[Section]) -> str:
    """Return the findings as one JSON object, by the titles of the sections."""
    content = {
        section.title: [finding._asdict() for finding in section.findings] for section in sections
    }
    return json.dumps(content, indent=1)


def as_text(sections: Sequence[Section]) -> str:
    """Return one line a finding, with what to do below it."""
    width = max(len(finding.name) for section in sections for finding in section.findings)
    lines = []
    for section in sections:
        lines += ["", section.title]
        for name, ok, detail, advice in section.findings:
            lines.append(f"  {'ok' if ok else 'no'} {name:{width}}  {detail}")
            if advice:
                lines.append(f"    {'':{width}}   do: {advice}")
    return "\n".join(lines[1:])


if __name__ == "__main__":
    sys.exit(main())
