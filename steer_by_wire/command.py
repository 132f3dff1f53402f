"""The one command: ``steer-by-wire NAME ...`` starts every program of the project.

Each program has its own parser and its own ``--help``; here are only the names, in the order in
which a newcomer needs them. A program is imported only when it is started, and what completion
does without only where it is used: every key in the shell starts this again.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from . import __version__
from .completion import answer_from_cache, keep, offer_values

if TYPE_CHECKING:
    from argparse import ArgumentParser

NAME = "steer-by-wire"
SHELLS = ("bash", "zsh", "fish")
STATUS_USAGE, STATUS_INTERRUPTED = 2, 130


class Program(NamedTuple):
    """One subcommand.

    ``module``       in this package
    ``summary``      one line for the list
    ``main``         its function, which takes the arguments and returns an exit status
    ``subcommands``  with a ``--help`` of their own
    """

    module: str
    summary: str
    main: str = "main"
    subcommands: tuple[str, ...] = ()


def _tool(name: str, summary: str, *subcommands: str) -> Program:
    return Program(f"tools.{name}.__main__", summary, subcommands=subcommands)


GROUPS: Mapping[str, Mapping[str, Program]] = MappingProxyType(
    {
        "Run the loop": {
            "demo": _tool("demo", "laws side by side as latency grows, with pictures"),
            "run": _tool("run", "plant and controller in virtual time, without waiting"),
            "plant": Program("plant_emulator.__main__", "the plant on a CAN bus"),
            "controller": Program("controller.__main__", "the controller on a CAN bus"),
            "hand-wheel": Program(
                "hand_wheel.__main__", "a hand wheel with force feedback, and its driver"
            ),
            "bus": _tool("bus", "an emulated CAN bus"),
        },
        "Watch it": {
            "cockpit": _tool("cockpit", "watch and drive the loop in a browser"),
            "monitor": _tool("monitor", "watch a bus in the terminal"),
            "analyze": _tool("analyze", "a recording as signals, latencies and a report"),
            "can": _tool(
                "can",
                "bounds on the delay of each message on a bus",
                "response-times",
            ),
        },
        "Design and test": {
            "check": Program(
                "controller.command_line.program",
                "poles, stable delays, tolerated jitter of a controller",
                "check_main",
            ),
            "dialect": _tool("dialect", "a car's own messages: new, check", "new", "check"),
            "design": _tool("design", "gains for your vehicle and any delay up to a limit"),
            "feedback": _tool(
                "feedback", "which delay makes a hand wheel with force feedback shake"
            ),
            "identify": _tool("identify", "your car from its logs, with intervals"),
            "generate-c": Program("tools.generate_c.__main__", "a controller as C99"),
            "study": _tool("study", "thousands of runs over latency, jitter, laws and vehicles"),
            "paper": _tool("paper", "the paper's figures and tables, reproduced"),
        },
        "This machine": {
            "doctor": _tool("doctor", "what this machine has for CAN; which rate it can keep"),
            "with-vcan": Program("with_vcan.__main__", "run a command with a real vcan0"),
        },
    }
)
PROGRAMS: Mapping[str, Program] = MappingProxyType(
    {name: program for group in GROUPS.values() for name, program in group.items()}
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one program; returns its exit status, 2 for an unknown name."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if "_ARGCOMPLETE" in os.environ:
        return _complete()
    if words[:1] == ["help"] and len(words) > 1:
        words = [words[1], "--help"]
    match words:
        case []:
            print(_help(), file=sys.stderr)
            return STATUS_USAGE
        case ["-h" | "--help" | "help", *_]:
            return _print(_help())
        case ["-V" | "--version", *_]:
            return _print(f"{NAME} {__version__}")
        case ["--completion", *shells]:
            return _print_completion(shells)
        case [name, *further] if name in PROGRAMS:
            return start(name, further)
    return _refuse(NAME, f"no command {words[0]!r}{_nearest(words[0])}; see {NAME} --help")


def start(name: str, words: Sequence[str]) -> int:
    """Import a program and run it; a missing library is reported in one line."""
    try:
        from .runtime.command_line import start_program
    except KeyboardInterrupt:
        return STATUS_INTERRUPTED
    program = PROGRAMS[name]
    module = f"{__package__}.{program.module}"
    return start_program(module, words, name=f"{NAME} {name}", function=program.main)


def _print(text: str) -> int:
    """Print as long as someone reads; a pipe that was closed, as by ``head``, is no mistake."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _nearest(word: str) -> str:
    import difflib

    close = difflib.get_close_matches(word, PROGRAMS, n=2, cutoff=0.5)
    return f"; did you mean {' or '.join(close)}?" if close else ""


def _refuse(name: str, text: str) -> int:
    print(f"{name}: error: {text}", file=sys.stderr)
    return STATUS_USAGE


def _help() -> str:
    lines = [f"usage: {NAME} COMMAND ...", "", "CAN-bus steer-by-wire emulator and controller."]
    for title, programs in GROUPS.items():
        lines.append(f"{title}:")
        lines += [f"  {name:<16} {program.summary}" for name, program in programs.items()]
    lines += [
        "",
        "COMMAND --help explains one. See also --version, --completion bash|zsh|fish.",
        "",
        "example:",
        f"  {NAME} run --set plant.latency.downlink.mean_s=0.08",
    ]
    return "\n".join(lines)


def _print_completion(words: Sequence[str]) -> int:
    if list(words) not in [[shell] for shell in SHELLS]:
        return _refuse(NAME, f"--completion takes one of {', '.join(SHELLS)}")
    from argcomplete.shell_integration import shellcode

    return _print(shellcode([NAME], shell=words[0]))


def _complete() -> int:
    """Answer the shell's request for completions, which comes in the environment (argcomplete)."""
    line = os.environ["COMP_LINE"][: int(os.environ["COMP_POINT"])]
    named = line.split(maxsplit=2)[1:2]
    is_behind = len(line.split()) > 2 or line.endswith(" ")
    is_bash = os.environ.get("_ARGCOMPLETE_SHELL", "bash") == "bash"
    if named and is_behind and is_bash and answer_from_cache(named[0], line):
        return 0
    import argparse

    import argcomplete

    def answer(parser: "ArgumentParser", *_arguments: object) -> NoReturn:
        if named and parser.prog == f"{NAME} {named[0]}":
            keep(named[0], parser)
        offer_values(parser)
        argcomplete.autocomplete(parser, always_complete_options="long")
        raise SystemExit(0)

    words = argcomplete.lexers.split_line(line)[3]  # the complete words
    if len(words) > 1 and words[1] in PROGRAMS:
        os.environ["_ARGCOMPLETE"] = "2"  # the program's own words begin after its name
        argparse.ArgumentParser.parse_args = answer  # type: ignore[assignment,method-assign]
        return start(words[1], ())
    parser = argparse.ArgumentParser(prog=NAME, add_help=False)
    parser.add_argument("command", choices=[*PROGRAMS])
    return answer(parser)


if __name__ == "__main__":
    sys.exit(main())
