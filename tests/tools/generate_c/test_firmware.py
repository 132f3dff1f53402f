"""Firmware with a generated law: the C example in lockstep sends the frames of the Python law."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from steer_by_wire.closed_loop.lockstep.node import LockstepNode
from steer_by_wire.closed_loop.lockstep.program import LockstepProgram
from steer_by_wire.closed_loop.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.virtual_pair import make_virtual_plant, run_virtual_nodes
from steer_by_wire.controller.law_interface import LawInput
from steer_by_wire.controller.limits.steer_limits import limit_step
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import Decoded, LateralError, Mode, Sender, SteeringCommand, decode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.tools.generate_c.law_source import params_of
from tests.support.law_in_c import EXAMPLE, hosts, written

JITTERING = {
    "duration_s": 2.0,
    "sensor_noise": {"lateral_error_m": 0.002},
    "latency": {
        "downlink": {"mean_s": 0.05},
        "uplink": {"mean_s": 0.02, "spread_s": 0.01, "model": "normal", "loss": 0.01},
    },
}


class Overheard(LockstepNode):
    """A program in lockstep; ``heard`` has what it received and sent, in order."""

    def __init__(self, program: LockstepProgram) -> None:
        super().__init__(program, 0)
        self.heard: list[Frame] = []

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        sent = super().on_frame(frame, now_ns)
        self.heard += [frame, *sent]
        return sent


def test_it_sends_the_frames_of_the_python_law(tmp_path: Path) -> None:
    hosts()
    settings = controller_preset("practical_pd_ddob")
    make = ["make", "-s", "-f", str(EXAMPLE / "Makefile"), "LAW=.", f"PYTHON={sys.executable}"]
    folder = written(settings, tmp_path)
    subprocess.run([*make, "on_lockstep"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    _, edge = make_virtual_plant(PlantSettings.model_validate(JITTERING))
    with LockstepProgram([str(folder / "on_lockstep")]) as program:
        node = Overheard(program)
        run_virtual_nodes(edge, node, QuietBus(QUIET_BUS.bitrate_bit_s), None, lambda: False)
    assert node.failure == ""

    law, params, sender = settings.law_record, params_of(settings), Sender(SteeringCommand)
    state, steer_rad, commands, last = None, 0.0, 0, None
    for frame in node.heard:
        decoded = decode(frame)
        assert isinstance(decoded, Decoded)
        if isinstance(decoded.message, LateralError):
            last = decoded.message.lateral_error_m
        elif isinstance(decoded.message, SteeringCommand):
            assert last is not None
            state = law.at_rest(params, last) if state is None else state
            state, output = law.step(params, state, LawInput(last, steer_rad))
            steer_rad = limit_step(settings.steer_limits, steer_rad, output.steer_rad)
            assert frame == sender.frame((steer_rad, commands, Mode.ACTIVE))
            commands += 1
    assert commands > 100
