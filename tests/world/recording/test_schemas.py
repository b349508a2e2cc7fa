"""The messages' JSON schemas: valid as schemas, and true of the messages of real hunts."""

import msgpack
import pytest

from encircle.protocol.keys import ROBOT_CHANNELS, WORLD_CHANNELS
from encircle.protocol.wire.declaration import declared_fields
from encircle.runner.hunts import run
from encircle.runner.interventions import Interventions
from encircle.world.recording.recording import read_recording
from encircle.world.recording.schemas import KINDS, json_schema

TYPES = {
    "object": dict,
    "array": list,
    "string": (str, bytes),
    "boolean": bool,
    "null": type(None),
    "integer": int,
    "number": (int, float),
}
KEYWORDS = {
    "$schema": str,
    "title": str,
    "type": (str, list),
    "properties": dict,
    "required": list,
    "additionalProperties": (bool, dict),
    "items": dict,
    "prefixItems": list,
    "minItems": int,
    "maxItems": int,
    "anyOf": list,
    "contentEncoding": str,
    "description": str,
    "enum": list,
    "maxLength": int,
    "minimum": (int, float),
    "maximum": (int, float),
    "exclusiveMinimum": (int, float),
    "exclusiveMaximum": (int, float),
}
NUMBERS_BEYOND = {
    "minimum": lambda x, limit: x < limit,
    "maximum": lambda x, limit: x > limit,
    "exclusiveMinimum": lambda x, limit: x <= limit,
    "exclusiveMaximum": lambda x, limit: x >= limit,
}


def assert_schema(schema):
    """Known keywords only, each of its kind, all the way down."""
    for keyword, value in schema.items():
        assert isinstance(value, KEYWORDS[keyword]), keyword
    types = schema.get("type", [])
    assert set([types] if isinstance(types, str) else types) <= set(TYPES)
    inner = [*schema.get("anyOf", []), *schema.get("prefixItems", [])]
    inner += [*schema.get("properties", {}).values()]
    inner += [
        schema[k] for k in ("items", "additionalProperties") if isinstance(schema.get(k), dict)
    ]
    for part in inner:
        assert_schema(part)


def faults(schema, value, place="$"):
    """What in a value is against a schema, by the rules of JSON Schema for these keywords."""
    found = []
    if "anyOf" in schema and all(faults(s, value) for s in schema["anyOf"]):
        found.append(f"{place}: none of the choices")
    types = schema.get("type", [])
    types = [types] if isinstance(types, str) else types
    wrong_kind = isinstance(value, bool) and "boolean" not in types
    if types and (wrong_kind or not isinstance(value, tuple(TYPES[t] for t in types))):
        return [*found, f"{place}: {value!r} is no {types}"]
    if "enum" in schema and value not in schema["enum"]:
        found.append(f"{place}: {value!r} is not one of the choices")
    if isinstance(value, str) and len(value) > schema.get("maxLength", 10**9):
        found.append(f"{place}: {len(value)} characters")
    if isinstance(value, int | float):
        limits = [(k, is_beyond) for k, is_beyond in NUMBERS_BEYOND.items() if k in schema]
        found += [f"{place}: {k}" for k, is_beyond in limits if is_beyond(value, schema[k])]
    if isinstance(value, dict):
        known, more = schema.get("properties", {}), schema.get("additionalProperties", True)
        found += [f"{place}: lacks {n}" for n in schema.get("required", []) if n not in value]
        for name, item in value.items():
            if name in known or isinstance(more, dict):
                found += faults(known.get(name, more), item, f"{place}.{name}")
            elif not more:
                found.append(f"{place}: has {name}")
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", 10**9):
            found.append(f"{place}: {len(value)} items")
        first = schema.get("prefixItems", [])
        for k, item in enumerate(value):
            part = first[k] if k < len(first) else schema.get("items", {})
            found += faults(part, item, f"{place}[{k}]")
    return found


@pytest.mark.parametrize("channel", KINDS)
def test_a_schema_is_valid_and_names_every_field_and_no_other(channel):
    schema = json_schema(channel)
    assert_schema(schema)
    declared = declared_fields(KINDS[channel])
    assert list(schema["properties"]) == ["v", "run", *(field.name for field in declared)]
    always = [field.name for field in declared if not field.may_be_left_out]
    assert schema["required"] == ["v", "run", *always]
    assert schema["additionalProperties"] is False
    assert schema["title"] == channel
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"


def test_every_channel_that_carries_messages_has_a_schema():
    """Envelopes are taken apart before anything is recorded."""
    envelopes = {"observations", "answers"}
    assert set(KINDS) == {*ROBOT_CHANNELS, *WORLD_CHANNELS} - {"alive"} - envelopes


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """Some messages of hunts in which much happens, by channel, as plain maps."""
    changes = [
        "channel.loss={model='bernoulli', rate=0.3}",
        "ticks_max=60",
        "sensing.noise_m_std=0.1",
    ]
    found = {}
    for name in ("sim1", "sim2"):
        path = tmp_path_factory.mktemp("schemas") / name
        interventions = Interventions()
        interventions.give({"kind": "partition", "groups": [["r1"], ["r2"]], "tick": 9})
        run(name, link="memory", out=path, overrides=changes, interventions=interventions)
        for tick, topic, payload in read_recording(path).messages:
            if tick % 5 == 0 or "setup" in topic or "end" in topic:
                body = msgpack.unpackb(payload)
                found.setdefault(topic.rsplit("/", 1)[1], []).append(body)
    return found


@pytest.mark.parametrize("channel", KINDS)
def test_messages_of_a_hunt_are_as_their_schema_says(messages, channel):
    schema = json_schema(channel)
    assert messages[channel]
    for body in messages[channel]:
        assert faults(schema, body) == []


@pytest.mark.parametrize("channel", KINDS)
def test_a_message_with_a_field_too_few_too_many_or_of_a_wrong_type_is_not(messages, channel):
    schema = json_schema(channel)
    body = messages[channel][0]
    assert faults(schema, body | {"colour": 1})
    for name in body:
        assert faults(schema, {n: v for n, v in body.items() if n != name})
        assert faults(schema, body | {name: {"no": {}}}) or name in ("parameters", "event")


def test_a_field_is_described_in_plain_text_with_its_unit():
    described = json_schema("setup")["properties"]
    assert described["tick_s"]["description"] == "length of a tick (s)"
    assert described["answer_tick"]["description"] == (
        "the first tick to be answered; see Leaving and coming back"
    )


@pytest.mark.parametrize(
    ("channel", "field", "value"),
    [
        ("setup", "tick_s", 0.0),
        ("setup", "radio", "wifi"),
        ("observation", "tick", -1),
        ("observation", "heading_rad", 3.2),
        ("observation", "scan", [1.0] * 7),
        ("observation", "scan", [1.0] * 361),
        ("observation", "seen", [["r2", 1.0]]),
        ("pose", "mode", "x" * 257),
        ("pose", "position", [1e9, 0.0]),
        ("pose", "relayed", [["r2", 1, 1.0, 2.0]] * 17),
        ("command", "timing", [1, 2, [["r2", 1, -1]]]),
        ("end", "reason", "failed: " + "x" * 193),
    ],
)
def test_a_value_beyond_the_limits_of_its_field_is_not(messages, channel, field, value):
    body = messages[channel][0]
    assert faults(json_schema(channel), body) == []
    assert faults(json_schema(channel), body | {field: value})
