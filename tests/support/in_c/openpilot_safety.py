"""openpilot's safety code, which stands between its controller and a car, as a library.

The package opendbc has the C of it as headers, and not the one file that its own tests compile.
"""

import ctypes
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

SOURCE = """
#include "opendbc/safety/tests/libsafety/fake_stm.h"
#include "opendbc/safety/can.h"
#include "opendbc/safety/safety.h"

static CANPacket_t packet(unsigned can_id, unsigned bus, const unsigned char *data, unsigned length)
{
    CANPacket_t it = {0};

    it.addr = can_id;
    it.extended = can_id > 0x7FF;
    it.bus = bus;
    while (dlc_to_len[it.data_len_code] < length)
        it.data_len_code++;
    for (unsigned i = 0; i < length; i++)
        it.data[i] = data[i];
    return it;
}

bool car_sends(unsigned can_id, unsigned bus, const unsigned char *data, unsigned length)
{
    CANPacket_t it = packet(can_id, bus, data, length);

    return safety_rx_hook(&it);
}

bool may_send(unsigned can_id, unsigned bus, const unsigned char *data, unsigned length)
{
    CANPacket_t it = packet(can_id, bus, data, length);

    return safety_tx_hook(&it);
}

bool second_passes(void)
{
    safety_mode_cnt++;
    safety_tick(&current_safety_config);
    return !safety_rx_checks_invalid && !relay_malfunction;
}

void set_time(unsigned time_us) { timer_cnt = time_us; }
bool may_control(void) { return controls_allowed; }
"""


class SafetyCode:
    """Judges the frames of a car and of its controller.

    ``params``  of the car, by opendbc

    ``accepted``    frames by their sender, ``car`` or ``controller``
    ``refused_ns``  when one was not
    ``invalid_s``   seconds in which a message of the car was late or invalid
    """

    def __init__(self, opendbc: Any, params: Any, folder: Path) -> None:
        source, library = folder / "safety.c", folder / "libsafety.so"
        source.write_text(SOURCE, encoding="utf-8")
        root = Path(opendbc.__file__).parents[1]
        compiler = ["gcc", "-std=gnu11", "-O1", "-shared", "-fPIC", f"-I{root}"]
        subprocess.run([*compiler, "-o", library, source], check=True)
        self._code = ctypes.CDLL(str(library))
        for name in ("car_sends", "may_send", "second_passes", "may_control"):
            getattr(self._code, name).restype = ctypes.c_bool
        config = params.safetyConfigs[0]
        self._code.set_safety_hooks(int(config.safetyModel.raw), int(config.safetyParam))
        self.accepted = Counter[str]()
        self.refused_ns: dict[str, list[int]] = {"car": [], "controller": []}
        self.invalid_s: list[int] = []
        self._second = 0

    @property
    def may_control(self) -> bool:
        """Whether the controller may steer."""
        return bool(self._code.may_control())

    def car_sends(self, now_ns: int, can_id: int, data: bytes, bus: int) -> None:
        """Take a frame of the car."""
        self._take("car", self._code.car_sends, now_ns, can_id, bus, data)

    def controller_sends(self, now_ns: int, can_id: int, data: bytes, bus: int) -> None:
        """Take a frame of the controller."""
        self._take("controller", self._code.may_send, now_ns, can_id, bus, data)

    def _take(
        self, sender: str, judge: Any, now_ns: int, can_id: int, bus: int, data: bytes
    ) -> None:
        self._code.set_time(now_ns // 1000)
        second = now_ns // 1_000_000_000
        if second > self._second:
            self._second = second
            if not self._code.second_passes():
                self.invalid_s.append(second)
        if judge(can_id, bus, data, len(data)):
            self.accepted[sender] += 1
        else:
            self.refused_ns[sender].append(now_ns)
