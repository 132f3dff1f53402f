"""Drives a law in Python and as generated C with the same drawn errors, and compares the bits.

Each tick: a start where one is drawn, the law, the fade after a start, the limits; as in
``controller.node.law_runner``. Every number that a tick gives is compared, NaN with any NaN. The C
is a program on the host, or of a Cortex-M7 under QEMU, with the
ends of the lockstep protocol.
"""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from steer_by_wire.closed_loop.lockstep.record import RECORD_BYTES, Record, pack
from steer_by_wire.controller.law_interface import LawInput, VehicleReading
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.limits.fades_and_ramps import difference_step, ramp_step
from steer_by_wire.controller.limits.steer_limits import limit_step
from steer_by_wire.controller.settings import PRESETS, ControllerSettings, controller_preset
from steer_by_wire.runtime.settings import preset_names
from steer_by_wire.tools.generate_c.law_source import LAWS, law_source

ROOT = Path(__file__).resolve().parents[3]
PROTOCOL = ROOT / "closed_loop/lockstep"
Floats = npt.NDArray[np.float64]
STRICT = (
    *("-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"),
    *("-I.", f"-I{PROTOCOL}"),
)
DRIVE = """
#include "lockstep.h"
#include "steering_law.h"

enum { TICKS = 26, COLUMNS = 6 };

int read_record(struct lockstep_record *record);
int write_record(const struct lockstep_record *record);

/* Both directions are a record without frames: numbers stand in their place. */
static union {
    struct lockstep_record record;
    struct { unsigned char head[16]; double numbers[TICKS][COLUMNS]; } of;
} in, out;
static struct law law;
static double sent_rad, fade_rad;

static void tick(const double *driven, double *row)
{
    const double error_m = driven[0];
    const bool starts = driven[1] > 0.0;
    const struct vehicle_reading vehicle = {driven[2], 0.0, driven[3], driven[4] > 0.0};

    if (starts)
        law_start(&law, error_m);
    struct law_output it = law_step(&law, error_m, sent_rad, &vehicle);
    fade_rad = difference_step(RAMP_STEP_RAD, fade_rad, sent_rad, it.steer_rad, starts);
    sent_rad = limit_step(&STEER_LIMITS, sent_rad, it.steer_rad + fade_rad);
    row[0] = it.steer_rad;
    row[1] = it.disturbance_rad;
    row[2] = it.network_disturbance_rad;
    row[3] = it.compensated_lateral_error_m;
    row[4] = sent_rad;
    row[5] = ramp_step(RAMP_STEP_RAD, sent_rad);
}

int main(void)
{
    while (read_record(&in.record)) {
        for (int i = 0; i < TICKS; i++)
            tick(in.of.numbers[i], out.of.numbers[i]);
        if (!write_record(&out.record))
            return 1;
    }
    return 0;
}
"""
TICKS_A_RECORD, COLUMNS = 26, 6
HEAD = pack(Record(0, 0))[:16]
ROOM = RECORD_BYTES - len(HEAD)
EXTREMES = (0.0, -0.0, 5e-324, -1e-310, 1e155, -1e300, float("inf"), float("nan"))
M7_FLAGS = (
    *("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-mthumb"),
    *("-ffreestanding", "-nostdlib", "-T", str(PROTOCOL / "m7.ld")),
)
SANITIZED = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
QEMU = (
    *("qemu-system-arm", "-M", "mps2-an500", "-nographic", "-serial", "none", "-monitor", "none"),
    *("-semihosting-config", "enable=on,target=native", "-kernel"),
)


class Target(NamedTuple):
    """How C becomes a program: compiler, its options, and what runs the program."""

    compiler: str
    options: tuple[str, ...]
    runner: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.compiler} {self.options[0]}"


def presets_in_c() -> list[str]:
    """Return every preset whose law becomes C."""
    return [it for it in preset_names(PRESETS) if controller_preset(it).law in LAWS]


def hosts(compiler: str = "gcc") -> list[Target]:
    """Return the targets of this machine by a compiler; skips the test where it is missing."""
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed: it did not compile the generated C")
    return [Target(compiler, (option,)) for option in ("-O0", "-O2")]


def m7(option: str) -> Target:
    """Return the Cortex-M7; skips the test where its compiler or QEMU is missing."""
    for tool in ("arm-none-eabi-gcc", QEMU[0]):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed: generated C did not run on a Cortex-M7")
    return Target("arm-none-eabi-gcc", (option, *M7_FLAGS), QEMU)


def drawn(seed: int, ticks: int) -> Floats:
    """Return rows of what a tick reads.

    A lateral error [m], a walk with jumps, steps and extremes; 1 where the law starts; speed [m/s];
    curvature [1/m]; 1 where these two are stale.
    """
    random = np.random.default_rng(seed)
    errors_m = np.cumsum(random.normal(0.0, 1e-3, ticks))
    errors_m += np.where(random.random(ticks) < 0.02, random.normal(0.0, 1.0, ticks), 0.0)
    errors_m += np.repeat(random.normal(0.0, 0.5, ticks // 100 + 1), 100)[:ticks]
    is_extreme = random.random(ticks) < 0.003
    errors_m[is_extreme] = random.choice(EXTREMES, int(is_extreme.sum()))
    starts = (random.random(ticks) < 0.005).astype(float)
    starts[0] = 1.0
    # A state that is not finite stays so until the law starts anew.
    starts[1:][~(np.abs(errors_m[:-1]) < 1e100)] = 1.0
    speeds_m_s = np.abs(np.cumsum(random.normal(0.0, 0.2, ticks)))
    curvatures_1_m = np.repeat(random.normal(0.0, 0.05, ticks // 50 + 1), 50)[:ticks]
    are_stale = np.repeat(random.random(ticks // 20 + 1) < 0.2, 20)[:ticks]
    return np.column_stack([errors_m, starts, speeds_m_s, curvatures_1_m, are_stale])


def in_python(settings: ControllerSettings, driven: Floats) -> Floats:
    """Return what each tick gives in Python."""
    design, limits = design_law(settings), settings.steer_limits
    step = settings.supervision.ramp_rad_s * settings.period_ns / 1_000_000_000
    rows, state, sent_rad, fade_rad = [], None, 0.0, 0.0
    for error_m, start, speed_m_s, curvature_1_m, is_stale in driven.tolist():
        if start:
            state = design.initial_state(error_m)
        vehicle = VehicleReading(speed_m_s, 0.0, curvature_1_m, bool(is_stale))
        observed = LawInput(error_m, sent_rad, vehicle)
        state, output = design.step(design.params, state, observed)
        fade_rad = difference_step(step, fade_rad, sent_rad, output.steer_rad, bool(start))
        sent_rad = limit_step(limits, sent_rad, output.steer_rad + fade_rad)
        rows.append((*output, sent_rad, ramp_step(step, sent_rad)))
    return np.array(rows)


def written(settings: ControllerSettings, folder: Path) -> Path:
    """Write the generated files and the driver; return the folder."""
    for name, text in {**law_source(settings, "a test"), "drive.c": DRIVE}.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def built(folder: Path, target: Target) -> Path:
    """Compile the C of a folder; return the program. Raises CalledProcessError."""
    program = folder / f"on_{target.compiler}{target.options[0]}"
    end = PROTOCOL / ("m7.c" if target.runner else "host.c")
    source = ["steering_law.c", "drive.c", str(end), *(["-lgcc"] if target.runner else [])]
    build = [target.compiler, *STRICT, *target.options, "-o", str(program), *source]
    subprocess.run(build, cwd=folder, check=True)
    return program


def in_c(program: Path, driven: Floats, runner: Sequence[str] = ()) -> Floats:
    """Return what each tick gives in a program."""
    records = -(-len(driven) // TICKS_A_RECORD)
    rows = np.zeros((records, TICKS_A_RECORD * COLUMNS))
    rows.reshape(-1, COLUMNS)[: len(driven), : driven.shape[1]] = driven
    asked = b"".join(HEAD + row.tobytes().ljust(ROOM, b"\0") for row in rows)
    run = subprocess.run([*runner, str(program)], input=asked, stdout=subprocess.PIPE, check=True)
    answers = np.frombuffer(run.stdout, np.uint8).reshape(-1, RECORD_BYTES)[:, len(HEAD) :]
    numbers = np.ascontiguousarray(answers[:, : rows.itemsize * rows.shape[1]]).view(np.float64)
    return numbers.reshape(-1, COLUMNS)[: len(driven)]


def differing(one: Floats, other: Floats) -> int:
    """Return the first tick at which two runs differ in a bit, -1 for none."""
    same = (one.view(np.uint64) == other.view(np.uint64)) | (np.isnan(one) & np.isnan(other))
    rows = np.flatnonzero(~same.all(axis=1))
    return int(rows[0]) if len(rows) else -1
