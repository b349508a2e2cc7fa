"""The layout for Foxglove names topics and fields that the exported file has."""

import json

import pytest
from helpers_exports import lossy_hunt
from helpers_protobuf import decoded_messages

from encircle.exports import foxglove_file
from encircle.exports.foxglove_layout import export


def found(tree, key):
    """All values of a key in a tree of JSON."""
    if isinstance(tree, dict):
        own = [tree[key]] if key in tree else []
        return own + [value for part in tree.values() for value in found(part, key)]
    if isinstance(tree, list):
        return [value for part in tree for value in found(part, key)]
    return []


@pytest.fixture(scope="module")
def layout(tmp_path_factory):
    path = tmp_path_factory.mktemp("layout") / "layout.json"
    export(lossy_hunt(), path)
    return json.loads(path.read_text())


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    path = tmp_path_factory.mktemp("foxglove") / "hunt.mcap"
    foxglove_file.export(lossy_hunt(), path)
    return decoded_messages(path)


def test_every_series_is_a_field_of_a_topic(layout, messages):
    fields = {}
    for topic, _, _, message in messages:
        fields.setdefault(topic, set()).update(message)
    series = [path for paths in found(layout, "paths") for path in found(paths, "value")]
    assert len(series) >= 3 + 5 + 3
    for path in series:
        topic, field = path.split(".")
        assert field in fields[topic], path


def test_the_views_show_topics_that_are_there_and_hide_the_rest(layout, messages):
    there = {topic for topic, *_ in messages}
    views = found(layout, "topics")
    assert len(views) == 2
    for view in views:
        assert view.keys() == {topic for topic in there if topic.startswith("/scene/")}
    shown = [{topic for topic, how in view.items() if how["visible"]} for view in views]
    assert "/scene/bodies" in shown[0]
    assert shown[1] == {"/scene/arena", "/scene/beliefs/r2"}
    assert found(layout, "topicToRender") == ["/events"]
