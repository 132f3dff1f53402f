"""Attributes of the DBC for an interaction layer: both nodes conform to them.

The names are those of Vector's interaction layer; the E2E parameters' are those of AUTOSAR.
"""

from cantools.database.can import Message as Definition

from steer_by_wire.controller.node.newest_messages import RECEIVED as CONTROLLER_RECEIVES
from steer_by_wire.controller.node.newest_messages import SUPERVISED
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.codec.protection import protect
from steer_by_wire.dbc.contract.dbc_file import load_database
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    CYCLE_TIMES_MS,
    DATA_IDS,
    EVENTS,
    MESSAGE_TYPES,
    ControllerStatus,
    Decoded,
    DelayStatus,
    Direction,
    EchoState,
    LatencyConfig,
    LatencySet,
    Mode,
    PathAhead,
    PlantStatus,
    Rejection,
    SafetyState,
    SteeringCommand,
    SteeringPlan,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    decode,
    frame_of,
)
from steer_by_wire.dbc.reception import cycle_ns
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.steering.settings import design_guard
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS

DATABASE = load_database()
CONTROLLER = controller_preset("practical_pd")


def attributes(definition: Definition) -> dict[str, object]:
    """Those that are not the DBC's defaults."""
    assert definition.dbc is not None
    return {name: attribute.value for name, attribute in definition.dbc.attributes.items()}


def start_frame(definition: Definition) -> Frame:
    """What an interaction layer sends before anybody has written a value."""
    raws = {signal.name: int(signal.raw_initial or 0) for signal in definition.signals}
    payload = bytearray(definition.encode(raws, scaling=False, strict=False))
    message_type = MESSAGE_TYPES[definition.name]
    if message_type in DATA_IDS:
        protect(payload, DATA_IDS[message_type])
    return frame_of(definition.frame_id, bytes(payload))


def test_an_interaction_layer_starts_with_nothing_that_anybody_would_act_on() -> None:
    started = {
        MESSAGE_TYPES[definition.name]: decode(start_frame(definition))
        for definition in DATABASE.messages
    }
    refused = {kind.__name__ for kind, got in started.items() if got is Rejection.NOT_AVAILABLE}
    assert refused == {"SteeringCommand", "SteeringPlan", "LateralError"}
    said = [got.message for got in started.values() if isinstance(got, Decoded)]
    assert len(said) + len(refused) == len(MESSAGE_TYPES)
    for message in said:
        match message:
            case SteeringStatus():
                assert message.status is SteeringStatusCode.NO_COMMAND
            case VehicleState():
                assert message == (0.0, 0.0, 0.0)
            case PathAhead():
                assert not any(message[2:])
            case ControllerStatus():
                assert message.mode is Mode.WAITING
            case DelayStatus():
                assert message.echo_state is EchoState.UNKNOWN
            case PlantStatus():
                assert message.safety is SafetyState.NORMAL
            case LatencyConfig() | LatencySet():
                assert message == (Direction.BOTH, 0, 0.0, 0.0, 0.0)
            case _:
                assert not any(message)


def test_a_message_that_is_sent_at_changes_says_at_those_of_which_signals() -> None:
    sent: dict[str, set[str]] = {}
    for definition in DATABASE.messages:
        for signal in definition.signals:
            assert signal.dbc is not None
            kind = signal.dbc.attributes.get("GenSigSendType")
            if kind is not None:
                choices = kind.definition.choices
                assert choices is not None
                sent.setdefault(choices[int(kind.value)], set()).add(signal.name)
    latency = ("DIRECTION", "MODEL", "MEAN", "SPREAD", "LOSS")
    disturbance = ("SIDE_FORCE", "YAW_MOMENT", "STEERING_OFFSET", "FRICTION_LOSS")
    freshness = ("LATERAL_ERROR", "STEERING_STATUS", "VEHICLE_STATE")
    assert sent == {
        "OnChange": {
            "CONTROLLER_SAFETY_REJECTED",
            "CONTROLLER_SAFETY_SECOND_SENDER",
            "FAULT",
            "MOTION_REQUEST",
            "SAFETY",
            "VALIDITY",
            *(f"{name}_FRESHNESS" for name in freshness),
        },
        "OnWrite": {*latency, *disturbance}
        | {f"LATENCY_SET_{name}" for name in latency}
        | {f"DISTURBANCE_SET_{name}" for name in disturbance},
    }


def test_no_message_follows_its_last_sooner_than_its_sender_can_send_it() -> None:
    found = {
        definition.name: attributes(definition).get("GenMsgDelayTime")
        for definition in DATABASE.messages
    }
    period_ms = CYCLE_TIMES_MS[SteeringCommand]
    assert {name: delay for name, delay in found.items() if delay is not None} == {
        "CONTROLLER_SAFETY": period_ms
    }


def test_a_receiver_times_out_when_our_nodes_do() -> None:
    assert DATABASE.dbc is not None
    guard = design_guard(PlantSettings().safety, PlantSettings().vehicle, PlantSettings().actuator)
    limits = CONTROLLER.age_limits
    expected_ns = {
        ("PLANT", CAN_IDS[SteeringCommand]): guard.silence_ns,
        ("PLANT", CAN_IDS[SteeringPlan]): guard.silence_ns,
        ("CONTROLLER", 0x110): limits.lateral_error_ns,
        ("CONTROLLER", 0x120): limits.steering_status_ns,
        ("CONTROLLER", 0x130): limits.vehicle_state_ns,
    }
    assert {can_id for node, can_id in expected_ns if node == "CONTROLLER"} == {
        CAN_IDS[message_type] for message_type in SUPERVISED
    }
    for definition in DATABASE.messages:
        for signal in definition.signals:
            for node in ("PLANT", "CONTROLLER", "TOOL"):
                timeout_ns = expected_ns.get((node, definition.frame_id))
                expected = None if timeout_ns is None else timeout_ns / NS_PER_MS
                assert timeout_ms(definition, signal.name, node) == expected, signal.name


def timeout_ms(definition: Definition, signal: str, node: str) -> float | None:
    """After how long without the message the node takes the signal for gone."""
    assert DATABASE.dbc is not None
    attributes_of_pairs = DATABASE.dbc.relation_attributes
    assert attributes_of_pairs is not None
    relations = attributes_of_pairs.node_signal_relations
    try:
        return float(relations[definition.frame_id][signal][node]["GenSigTimeoutTime"].value)
    except KeyError:
        return None


def test_the_e2e_parameters_are_those_both_receivers_check_with() -> None:
    for definition in DATABASE.messages:
        found = attributes(definition)
        message_type = MESSAGE_TYPES[definition.name]
        if message_type in DATA_IDS:
            assert found["E2EDataLength"] == 8 * definition.length
            is_received = message_type in CONTROLLER_RECEIVES
            rule = CONTROLLER.counters if is_received else PlantSettings().counters
            period_ns = cycle_ns(message_type)
            ahead_ns = rule.lead_ns + rule.resync_ns
            step_max = 127 if message_type in EVENTS else 1 + ahead_ns // period_ns
            assert found["E2EMaxDeltaCounter"] == step_max, definition.name
        else:
            assert not any(name.startswith("E2E") for name in found)


def test_what_only_a_test_rig_has_is_marked() -> None:
    marked = {
        definition.name
        for definition in DATABASE.messages
        if attributes(definition).get("RigMessage") == 1
    }
    by_tools = {
        f"{what}_{kind}" for what in ("LATENCY", "DISTURBANCE") for kind in ("CONFIG", "SET")
    }
    assert marked == {"PLANT_STATUS", "GROUND_TRUTH", "CAR_TRUTH", *by_tools}
