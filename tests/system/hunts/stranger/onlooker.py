"""Somebody who only looks on: python onlooker.py ENDPOINT PAUSE_S DIRECTORY WHAT...

WHAT is ``WHO:HOW:KEY``, each with a session of its own: HOW is ``hear`` (subscribe to messages),
``read`` (likewise, and print of each that says something tick, robot and what it says, as JSON),
``watch`` (subscribe to tokens), ``answer`` (be asked) or ``ask`` (many questions at once). After
each message it pauses. WHO is whose certificate of DIRECTORY it shows, if that is not empty. Its
buffers are small and its connections never expire, so that it is soon felt that it does not read,
and for as long as it lives.
"""

import json
import sys
import time

import msgpack
import zenoh

QUESTIONS = 3000
LONGEST_S = 3600.0


def settings(endpoint, directory, who):
    found = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 30_000,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": 1_000_000_000,
        "transport/link/tcp/so_rcvbuf": 4096,
        "transport/link/tls/so_rcvbuf": 4096,
    }
    if directory:
        found |= {
            "transport/link/tls/root_ca_certificate": f"{directory}/authority.pem",
            "transport/link/tls/enable_mtls": True,
            "transport/link/tls/connect_certificate": f"{directory}/{who}.pem",
            "transport/link/tls/connect_private_key": f"{directory}/{who}.key",
        }
    return found


def read(sample):
    message = msgpack.unpackb(sample.payload.to_bytes())
    # Several robots' answers, or one robot's, may come in one envelope.
    for _robot, channel, payload, _inbox in message.get("messages", ()):
        if channel == "pose":
            tell(msgpack.unpackb(payload))
    tell(message)


def tell(message):
    if message.get("say"):
        # In one piece: each subscriber has a thread, and print writes a line's end apart.
        sys.stdout.write(json.dumps([message["tick"], message["robot"], message["say"]]) + "\n")
        sys.stdout.flush()


def look_on(session, how, key, pause):
    if how == "read":
        return session.declare_subscriber(key, zenoh.handlers.Callback(read, indirect=False))
    handler = zenoh.handlers.Callback(lambda _said: time.sleep(pause), indirect=False)
    if how == "hear":
        return session.declare_subscriber(key, handler)
    if how == "ask":
        for _ in range(QUESTIONS):
            session.get(key, handler, timeout=LONGEST_S)
        return None
    if how == "watch":
        return session.liveliness().declare_subscriber(key, handler, history=True)
    return session.declare_queryable(key, handler)


def main(endpoint, pause_s, directory, *whats):
    kept = []
    for what in whats:
        who, how, key = what.split(":")
        config = zenoh.Config()
        for name, value in settings(endpoint, directory, who).items():
            config.insert_json5(name, json.dumps(value))
        session = zenoh.open(config)
        kept += [session, look_on(session, how, key, float(pause_s))]
    print("looking on", file=sys.stderr, flush=True)
    while True:
        time.sleep(1.0)


if __name__ == "__main__":
    main(*sys.argv[1:])
