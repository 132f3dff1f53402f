"""The C source that cantools generates from the DBC exchanges the same bytes as dbc.messages.

An ECU written in C gets its codec that way, so this is the second implementation of the contract.
"""

import random
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cantools.database.can import Message as Definition
from cantools.database.can.signal import Signal

from steer_by_wire import dbc
from steer_by_wire.dbc.codec.protection import header_bits, protect
from steer_by_wire.dbc.contract.dbc_file import load_database
from steer_by_wire.dbc.messages import Decoded, decode, encode, frame_of
from steer_by_wire.runtime.frame import Frame

DATABASE = load_database()
DBC_FILE = Path(dbc.__file__).with_name("steer_by_wire.dbc")
STRICT = ("-std=c99", "-O1", "-Wall", "-Wextra", "-Werror")

# Reads lines "identifier payload"; for each prints the payload after unpacking, decoding to
# physical values, encoding and packing again, and then the physical values.
MAIN = """
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "steer_by_wire.h"

int main(void)
{
    unsigned int can_id;
    char text[97];
    while (scanf("%x %96s", &can_id, text) == 2) {
        uint8_t bytes[48];
        size_t size = strlen(text) / 2;
        for (size_t i = 0; i < size; i++) {
            unsigned int byte;
            sscanf(text + 2 * i, "%2x", &byte);
            bytes[i] = (uint8_t)byte;
        }
        switch (can_id) {
CASES
        default:
            return 2;
        }
    }
    return 0;
}
"""


def case(definition: Definition) -> str:
    """The branch of ``MAIN`` for one message."""
    message = f"steer_by_wire_{definition.name.lower()}"
    signals = "\n".join(signal_lines(message, signal) for signal in definition.signals)
    return f"""
        case {definition.frame_id}: {{
            struct {message}_t m;
            if ({message}_unpack(&m, bytes, size) != 0) return 3;
            double value;
            char values[800] = "";
{signals}
            memset(bytes, 0xFF, sizeof bytes);
            if ({message}_pack(bytes, &m, size) != (int)size) return 5;
            for (size_t i = 0; i < size; i++) printf("%02x", bytes[i]);
            printf("%s\\n", values);
            break;
        }}"""


def signal_lines(message: str, signal: Signal) -> str:
    """Decode and encode one signal; the generated encode truncates, hence the half resolution."""
    name = signal.name.lower()
    return f"""
            if (!{message}_{name}_is_in_range(m.{name})) return 4;
            value = {message}_{name}_decode(m.{name});
            sprintf(values + strlen(values), " %.17g", value);
            m.{name} = {message}_{name}_encode(value + copysign({signal.scale / 2}, value));"""


def random_frame(definition: Definition, source: random.Random) -> Frame:
    """A valid frame with raw integers drawn from the whole range of each signal."""
    raws = {}
    for signal in definition.signals:
        assert signal.minimum is not None
        assert signal.maximum is not None
        ends = round(signal.minimum / signal.scale), round(signal.maximum / signal.scale)
        drawn = [*ends, source.randint(*ends), source.randint(*ends)]
        named = [raw for raw in signal.choices or () if ends[0] <= raw <= ends[1]]
        raws[signal.name] = source.choice(named or drawn)
    payload = bytearray(definition.encode(raws, scaling=False))
    if header_bits(definition.name).keys() <= raws.keys():
        assert definition.dbc is not None
        protect(payload, int(definition.dbc.attributes["E2EDataId"].value))
    return frame_of(definition.frame_id, bytes(payload))


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The generated source and ``MAIN``, compiled."""
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not installed: the generated C source was not compiled")
    folder = tmp_path_factory.mktemp("generated_c")
    generate = (sys.executable, "-m", "cantools", "generate_c_source", str(DBC_FILE))
    subprocess.run(generate, cwd=folder, check=True, capture_output=True)
    cases = "".join(case(definition) for definition in DATABASE.messages)
    (folder / "main.c").write_text(MAIN.replace("CASES", cases), encoding="ascii")
    compile_all = (compiler, *STRICT, "-o", "program", "main.c", "steer_by_wire.c", "-lm")
    compiled = subprocess.run(compile_all, cwd=folder, capture_output=True, text=True, check=False)
    assert compiled.returncode == 0, compiled.stderr
    return folder / "program"


def test_c_and_python_agree_on_every_byte_and_every_value(program: Path) -> None:
    source = random.Random(1)
    frames = [random_frame(message, source) for message in DATABASE.messages for _ in range(200)]
    lines = "".join(f"{frame.can_id:x} {frame.data.hex()}\n" for frame in frames)
    result = subprocess.run([program], input=lines, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout.splitlines()[-1:]
    for frame, line in zip(frames, result.stdout.splitlines(), strict=True):
        decoded = decode(frame)
        assert isinstance(decoded, Decoded)
        assert encode(*decoded) == frame
        payload, *values = line.split()
        assert payload == frame.data.hex()
        assert [float(value) for value in values][-len(decoded.message) :] == list(decoded.message)
