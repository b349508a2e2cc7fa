"""A client of Foxglove's WebSocket protocol that shares nothing with foxglove-sdk.

The server says what it has as JSON; whoever subscribes gets messages as bytes: a kind, the
subscription, the time in ns, and the payload.
"""

import asyncio
import base64
import contextlib
import json
import struct
import threading

from helpers_protobuf import Descriptors
from tornado.websocket import websocket_connect

PROTOCOL = "foxglove.sdk.v1"
MESSAGE, TIME = 1, 2


class Client:
    """Connects to an address, subscribes to topics, and keeps what it gets until the end.

    ``channels``: what was advertised, by topic; ``messages``: (topic, time in ns, message);
    ``times``: of the server, in ns. ``begun`` is set when what was asked for was sent.
    """

    def __init__(self, address: str, topics: list[str]):
        self.protocol, self.server, self.channels = None, None, {}
        self.messages, self.times = [], []
        self.begun, self.ended = threading.Event(), threading.Event()
        self.failure: Exception | None = None
        self._topics, self._address = topics, address
        self._hang_up = lambda: None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self):
        """Hang up, if the server has not, and wait for the end."""
        with contextlib.suppress(RuntimeError):  # it is over
            self._hang_up()
        self._thread.join()

    def _run(self):
        try:
            asyncio.run(self._listen())
        except Exception as error:  # told by the test
            self.failure = error
        self.ended.set()

    async def _listen(self):
        socket = await websocket_connect(self._address, subprotocols=[PROTOCOL])
        loop = asyncio.get_running_loop()
        self._hang_up = lambda: loop.call_soon_threadsafe(socket.close)
        self.protocol = socket.selected_subprotocol
        try:
            while (message := await socket.read_message()) is not None:
                if isinstance(message, str):
                    await self._take(socket, json.loads(message))
                else:
                    self._keep(message)
        finally:
            socket.close()

    async def _take(self, socket, said):
        if said["op"] == "serverInfo":
            self.server = said
        if said["op"] != "advertise":
            return
        self.channels |= {channel["topic"]: channel for channel in said["channels"]}
        if not self.begun.is_set() and set(self._topics) <= self.channels.keys():
            asked = [
                {"id": number, "channelId": self.channels[topic]["id"]}
                for number, topic in enumerate(self._topics)
            ]
            await socket.write_message(json.dumps({"op": "subscribe", "subscriptions": asked}))
            self.begun.set()

    def _keep(self, data):
        if data[0] == TIME:
            self.times += struct.unpack("<Q", data[1:9])
        elif data[0] == MESSAGE:
            number, time_ns = struct.unpack("<IQ", data[1:13])
            topic = self._topics[number]
            with contextlib.suppress(KeyError):
                self.messages.append((topic, time_ns, self._decoded(topic, data[13:])))

    def _decoded(self, topic, payload):
        channel = self.channels[topic]
        if channel["encoding"] == "json":
            return json.loads(payload)
        assert channel["encoding"] == "protobuf"
        descriptors = Descriptors(base64.b64decode(channel["schema"]))
        return descriptors.decoded(f".{channel['schemaName']}", payload)
