"""Which ticks and events an export shows, read back by other programs, each format by one."""

import base64
import gzip
import json
import re

import av
import pandas as pd
from helpers_protobuf import decoded_messages
from PIL import Image
from rerun.chunk import RrdReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

TICK_S = 0.1
"""How long a tick of most hunts in these tests is."""
RECORDING = re.compile(r'<script type="application/json" id="recording">([^<]*)</script>')
END_S = 1
"""For how long the last picture of a video stands."""


def scene_of_page(path):
    """What a page of one file holds of its run: stage, frames, status."""
    data = RECORDING.search(path.read_text(encoding="utf-8"))[1]
    return json.loads(gzip.decompress(base64.b64decode(data)))


def html_ticks(path, _tick_s=TICK_S):
    return [frame["t"] for frame in scene_of_page(path)["frames"]]


def parquet_ticks(path, _tick_s=TICK_S):
    return sorted(set(pd.read_parquet(path / "truth.parquet")["tick"]))


def foxglove_ticks(path, tick_s=TICK_S):
    found = decoded_messages(path)
    return [_tick(time_ns, tick_s) for topic, time_ns, *_ in found if topic == "/poses"]


def rerun_ticks(path, _tick_s=TICK_S):
    chunks = [c for c in RrdReader(path).stream() if c.entity_path == "/truth/target"]
    return [tick for c in chunks for tick in c.to_record_batch().to_pydict()["tick"]]


def rosbag2_ticks(path, tick_s=TICK_S):
    with Reader(path) as bag:
        return [_tick(ns, tick_s) for c, ns, _ in bag.messages() if c.topic == "/tf"]


def mp4_ticks(path, tick_s=TICK_S):
    """As many as the pictures before the end stand for."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        seconds = sum(1 for _ in container.decode(stream)) / stream.average_rate
    return _ticks_of(seconds, tick_s)


def gif_ticks(path, tick_s=TICK_S):
    length_ms = 0
    with Image.open(path) as image:
        for k in range(image.n_frames):
            image.seek(k)
            length_ms += image.info["duration"]
    return _ticks_of(length_ms / 1000, tick_s)


def _ticks_of(seconds, tick_s):
    return list(range(round((seconds - END_S) / tick_s) + 1))


def _tick(time_ns, tick_s=TICK_S):
    return round(time_ns / (tick_s * 1e9))


TICKS_OF = {
    "html": html_ticks,
    "parquet": parquet_ticks,
    "foxglove": foxglove_ticks,
    "rerun": rerun_ticks,
    "rosbag2": rosbag2_ticks,
    "mp4": mp4_ticks,
    "gif": gif_ticks,
}
"""By the format's name, from path and tick length; pictures of one tick and layouts have none."""


def html_events(path):
    return [(f["t"], text) for f in scene_of_page(path)["frames"] for _, text, _ in f["ev"]]


def parquet_events(path):
    events = pd.read_parquet(path / "events.parquet")
    return list(zip(events["tick"], events["text"], strict=True))


def foxglove_events(path):
    found = [(time, log) for topic, time, *_, log in decoded_messages(path) if topic == "/events"]
    return [(_tick(time_ns), log["message"]) for time_ns, log in found]


def rerun_events(path):
    events = []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path.startswith("/events/"):
            columns = chunk.to_record_batch().to_pydict()
            texts = [text for (text,) in columns["TextLog:text"]]
            events += zip(columns["tick"], texts, strict=True)
    return events


def rosbag2_events(path):
    types = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(path) as bag:
        return [
            (_tick(time_ns), types.deserialize_cdr(data, c.msgtype).msg)
            for c, time_ns, data in bag.messages()
            if c.topic == "/encircle/events"
        ]


EVENTS_OF = {
    "html": html_events,
    "parquet": parquet_events,
    "foxglove": foxglove_events,
    "rerun": rerun_events,
    "rosbag2": rosbag2_events,
}
"""By the format's name: tick and text of every event."""
