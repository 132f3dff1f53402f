"""The runs of a campaign: every case at every operating point with every law, and golden runs."""

import hashlib
import random
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

from ....controller.settings import ControllerSettings, controller_preset
from ....plant_emulator.faults.settings import FaultSettings
from ....plant_emulator.settings import PlantSettings
from ....runtime.node.end import End
from ....runtime.settings import load_settings
from . import detectability
from .campaign_file import (
    BUS,
    CampaignSettings,
    NodeFaultKind,
    PointSettings,
    direction_of,
)
from .node_faults import NodeFault

GOLDEN = "golden"
_BOTH = "both"


class FaultCase(NamedTuple):
    """What goes wrong in a run, and what is expected of it beforehand.

    ``kind``         of the fault, GOLDEN for none
    ``where``        message, or node
    ``receiver``     the node that has to detect it: controller, plant or both
    """

    kind: str
    where: str
    magnitude: float
    receiver: str
    expected: detectability.Expectation
    faults: tuple[FaultSettings, ...] = ()
    node_fault: NodeFault | None = None

    @property
    def label(self) -> str:
        """What goes wrong, in a line."""
        if self.kind == GOLDEN:
            return GOLDEN
        return f"{self.kind} {self.magnitude:g} {self.where}"

    @property
    def is_unreceived(self) -> bool:
        """Whether all faults act where no node listens."""
        return bool(self.faults) and all(map(detectability.is_unreceived, self.faults))


class Scenario(NamedTuple):
    """One run; equal ones have equal names and give equal results."""

    case: FaultCase
    point: PointSettings
    law: str
    seed: int
    spec: CampaignSettings

    @property
    def name(self) -> str:
        """Case, operating point, law and seed."""
        return f"{self.case.label} | {self.point.name} | {self.law} | {self.seed}"


def scenarios_of(spec: CampaignSettings) -> Iterator[Scenario]:
    """Yield every run of a campaign, golden ones first."""
    for point in spec.points:
        for law in laws_of(spec, point):
            for number in range(spec.golden_seeds):
                seed = _seed(spec, f"{point.name}{law}", number)
                yield Scenario(golden_case(), point, law, seed, spec)
    for point in spec.points:
        for law in laws_of(spec, point):
            yield from _faulty(spec, point, law)


def laws_of(spec: CampaignSettings, point: PointSettings) -> Sequence[str]:
    """Return the laws that are driven at an operating point."""
    return point.laws or spec.laws


def scenario_sight(spec: CampaignSettings, point: PointSettings, law: str) -> detectability.Sight:
    """Return what the mechanisms of the pairs of some runs can detect."""
    plant = plant_settings_of(Scenario(golden_case(), point, law, 0, spec), ())
    return detectability.sight_of(plant, controller_settings_of(law, spec.ftti_ms))


def _faulty(spec: CampaignSettings, point: PointSettings, law: str) -> Iterator[Scenario]:
    sight = scenario_sight(spec, point, law)
    sent = "STEERING_PLAN" if controller_settings_of(law).law_record.plan else "STEERING_COMMAND"
    for case_table in spec.cases:
        for message in case_table.messages:
            if message in detectability.COMMANDS and message != sent:
                continue
            for magnitude in case_table.magnitudes:
                seed = _seed(spec, f"{case_table.kind}{message}{magnitude}{point.name}{law}", 0)
                fault = FaultSettings(
                    kind=case_table.kind,
                    direction=direction_of(message),
                    message=message,
                    signal=case_table.signal_of(message),
                    onset_s=_onset_s(spec, sight, seed),
                    duration_s=spec.fault_s,
                    magnitude=magnitude,
                )
                if detectability.is_unreceived(fault):  # compared with the first golden run
                    seed = _seed(spec, f"{point.name}{law}", 0)
                yield Scenario(case_of_fault(fault, sight), point, law, seed, spec)
    for node_table in spec.node_cases:
        for node in node_table.nodes:
            for magnitude in node_table.magnitudes:
                seed = _seed(spec, f"{node_table.kind}{node}{magnitude}{point.name}{law}", 0)
                onset_s = _onset_s(spec, sight, seed)
                node_fault = NodeFault(node_table.kind, node, onset_s, spec.fault_s, magnitude)
                yield Scenario(case_of_node_fault(node_fault, sight), point, law, seed, spec)


def golden_case() -> FaultCase:
    """Return the case without a fault."""
    return FaultCase(GOLDEN, "", 0.0, _BOTH, detectability.Expectation((), False, "no fault"))


def case_of_fault(fault: FaultSettings, sight: detectability.Sight) -> FaultCase:
    """Return the case of one fault of the stage at the plant's edge."""
    receiver = End.PLANT if fault.direction == "downlink" else End.CONTROLLER
    kind, expected = fault.kind.value, detectability.expect_fault(fault, sight)
    return FaultCase(kind, fault.message, fault.magnitude, receiver, expected, faults=(fault,))


def case_of_node_fault(fault: NodeFault, sight: detectability.Sight) -> FaultCase:
    """Return the case of one fault of a node; its peer has to detect it."""
    receiver = {End.CONTROLLER: End.PLANT, End.PLANT: End.CONTROLLER, BUS: _BOTH}[fault.node]
    if fault.kind is NodeFaultKind.CLOCK_JUMP:
        receiver = fault.node
    kind, expected = fault.kind.value, detectability.expect_node_fault(fault, sight)
    return FaultCase(kind, fault.node, fault.magnitude, receiver, expected, node_fault=fault)


def plant_settings_of(scenario: Scenario, faults: Sequence[FaultSettings]) -> PlantSettings:
    """Return the plant's settings of a run."""
    point, spec = scenario.point, scenario.spec
    overrides = [f"seed={scenario.seed}", f"duration_s={spec.motion_s}"]
    overrides += [
        f"vehicle.speed_m_s={point.speed_m_s}",
        f"vehicle.virtual_mass_kg={point.virtual_mass_kg}",
        f"sensor_noise.lateral_error_m={point.noise_m}",
        f"safety.ftti_ms={spec.ftti_ms}",
    ]
    for line, mean_ms in (("downlink", point.downlink_ms), ("uplink", point.uplink_ms)):
        overrides.append(f"latency.{line}.mean_s={1e-3 * mean_ms}")
        if point.jitter_ms > 0.0:
            overrides += [
                f"latency.{line}.model=normal",
                f"latency.{line}.spread_s={1e-3 * point.jitter_ms}",
                f"latency.{line}.order=in_order",
            ]
    settings = load_settings(PlantSettings, None, None, overrides)
    further: dict[str, object] = {"faults": tuple(faults)}
    if point.path is not None:
        further["path"] = point.path
    return settings.model_copy(update=further)


@lru_cache(maxsize=64)
def controller_settings_of(law: str, ftti_ms: float | None = None) -> ControllerSettings:
    """Return the settings of a preset; raises SettingsError for an unknown one.

    ``ftti_ms``  the fault tolerant time, from which the age limits follow that the preset leaves
                 open; None: the preset's
    """
    overrides = [] if ftti_ms is None else [f"supervision.fault_tolerant_time_ms={ftti_ms}"]
    return controller_preset(law, overrides)


def _onset_s(spec: CampaignSettings, sight: detectability.Sight, seed: int) -> float:
    """Draw where in a control period the fault begins."""
    drawn = random.Random(seed).random()  # noqa: S311 no secret
    return round(spec.onset_s + sight.control_period_s * drawn, 6)


def _seed(spec: CampaignSettings, text: str, number: int) -> int:
    """Return the seed of a run, which depends on what it is and not on its place in the list."""
    digest = hashlib.blake2s(f"{spec.seed}/{text}/{number}".encode(), digest_size=4).digest()
    return int.from_bytes(digest, "little") >> 1
