"""A robot of other make: python robot.py ID RUN ENDPOINT. It needs zenoh and msgpack, nothing else.

It is written from docs/protocol.md alone and knows no code of the project. What it does: it takes
the newest detection of the target that it or anybody else has made, moves it on by how fast the
target went lately, and heads for its own share of a ring around it, which is where it stays in the
order in which the team stands around the target with equal gaps between them. Once all are near
and no gap is wide it goes in. A robot that the world calls lost has no share.

It speaks: it says at which bearing from the target its share lies, ``{"share": {"bearing_rad": b,
"of": how many}}``. And it listens: as long as the newest packet of a peer that it counts on says
``{"wait": true}``, it does not go in.
"""

import cmath
import json
import math
import queue
import sys
import time

import msgpack
import zenoh

VERSION = 4
RING_RADIUS_M = 4.0
NEAR = 1.5
WIDE_RAD = 1.1 * math.pi
LEAD_TICKS = 3
PEER_AGE_TICKS = 50
DETECTION_AGE_TICKS = 30
VELOCITY_TICKS = 6
KEEP_M = 0.08
JOIN_S = WORLD_AWAY_S = 30.0


class Robot:
    """Messages in, messages out: ``(channel, payload)``, without a network."""

    def __init__(self, me, run):
        self.me, self.run = me, run
        self.setup = None
        self.ended = None
        self.refused = {}

    def hear(self, channel, payload):
        """What to say to a message of the world."""
        message = self.opened(payload)
        if message is None or message.get("robot") != self.me:
            return self.refuse("wrong-sender" if message else "malformed")
        if channel == "setup":
            self.begin(message)
        elif channel == "end":
            self.ended = message["reason"]
        elif channel == "observation" and self.setup is not None:
            if payload != self.asked:  # asked twice, it says the same twice
                if message["tick"] != self.tick + 1:
                    return self.refuse("out-of-turn")
                self.asked, self.answer = payload, self.observe(message)
            return self.answer
        else:
            return self.refuse("out-of-turn")
        return []

    def refuse(self, cause):
        self.refused[cause] = self.refused.get(cause, 0) + 1
        return []

    def opened(self, payload):
        """A message as a map, or None if it is not one of this run and version."""
        try:
            message = msgpack.unpackb(payload)
        except Exception:
            return None
        named = type(message) is dict and message.get("run") == self.run
        return message if named and message.get("v") == VERSION else None

    def begin(self, setup):
        """A setup, at first or in the middle of a run: what was known before is forgotten."""
        self.setup = setup
        self.tick = setup["first_tick"] - 1
        self.asked, self.answer = None, []
        self.before = None
        self.peers = {}  # id: (tick, position, velocity per tick) as complex numbers
        self.heard = {}  # id: tick of its newest packet
        self.waiting = {}  # id: whether that said to wait
        self.lost = {}  # id: since which tick
        self.sightings = {}  # (tick, origin): position

    def observe(self, seen):
        self.tick = tick = seen["tick"]
        here = complex(*seen["position"])
        self.learn(seen)
        if tick < self.setup["answer_tick"]:
            self.before = here
            return []
        mode, goal, target, team, say = self.plan(here)
        step = self.clear(goal - here, here, seen, target)
        head = {"v": VERSION, "run": self.run, "robot": self.me, "tick": tick}
        why = {"mode": mode, "xi": None, "point": None}
        velocity = (here - (here if self.before is None else self.before)) / self.setup["tick_s"]
        self.before = here
        pose = {
            **head,
            "sequence": tick,
            "position": seen["position"],
            "velocity": pair(velocity),
            "detection": seen["target"],
            **why,
            "relayed": [],
            "sent_us": None,
            **({"say": say} if say else {}),
        }
        command = {
            **head,
            "step": pair(step),
            **why,
            "goal": pair(goal),
            "estimate": None if target is None else pair(target),
            "predictor": None,
            "team": team,
            "published": True,
            "refused": dict(self.refused),
            "timing": None,
        }
        return [("pose", msgpack.packb(pose)), ("command", msgpack.packb(command))]

    def learn(self, seen):
        """Take in what was sensed and heard."""
        tick, team = seen["tick"], self.setup["team"]
        self.lost = {robot: self.lost.get(robot, tick) for robot in seen["lost"]}
        if seen["target"] is not None:
            self.sightings[tick, self.me] = complex(*seen["target"])
        for packet in seen["inbox"]:
            pose = self.opened(packet)
            sender = pose and pose.get("robot")
            if sender not in team or sender == self.me or not pose["tick"] < tick:
                self.refuse("inbox")
                continue
            if sender not in self.peers or self.peers[sender][0] < pose["tick"]:
                velocity = complex(*pose["velocity"]) * self.setup["tick_s"]
                self.peers[sender] = (pose["tick"], complex(*pose["position"]), velocity)
            if pose["tick"] >= self.heard.get(sender, -1):
                say = pose.get("say", {})
                self.waiting[sender] = type(say) is dict and say.get("wait") is True
            self.heard[sender] = max(pose["tick"], self.heard.get(sender, -1))
            if pose["detection"] is not None:
                self.sightings[pose["tick"], sender] = complex(*pose["detection"])
            for origin, when, x, y in pose["relayed"]:
                if origin in team and when < pose["tick"]:
                    self.sightings.setdefault((when, origin), complex(x, y))
        for robot, x, y in seen["seen"]:
            self.peers[robot] = (tick, complex(x, y), self.peers.get(robot, (0, 0, 0j))[2])
        oldest = tick - DETECTION_AGE_TICKS
        self.sightings = {key: at for key, at in self.sightings.items() if key[0] >= oldest}

    def target_in(self, ticks):
        """Where the target will be in some ticks, None if it is not known where it is."""
        if not self.sightings:
            return None
        by_tick = {when: at for (when, _), at in sorted(self.sightings.items())}
        newest = max(by_tick)
        earlier = min(when for when in by_tick if when >= newest - VELOCITY_TICKS)
        velocity = (by_tick[newest] - by_tick[earlier]) / max(1, newest - earlier)
        return by_tick[newest] + velocity * (self.tick + ticks - newest)

    def members(self, here):
        """Where each robot is that can be counted on, this one included, in robot order."""
        found = {}
        for robot in self.setup["team"]:
            if robot == self.me:
                found[robot] = here
            elif robot in self.peers:
                when, place, velocity = self.peers[robot]
                # A lost robot's body is still there to be seen, so only its word counts.
                lost = self.heard.get(robot, -1) < self.lost.get(robot, -1)
                if not lost and when >= self.tick - PEER_AGE_TICKS:
                    found[robot] = place + velocity * (self.tick - when)
        return found

    def plan(self, here):
        """What it is up to, where it heads and takes the target to be, its team, what it says."""
        places = self.members(here)
        target, parameters = self.target_in(0), self.setup["parameters"]
        if target is None:
            return "search", here, None, list(places), {}
        ring = parameters.get("ring_radius_m", RING_RADIUS_M)
        rays = {robot: place - target for robot, place in places.items()}
        order = sorted(rays, key=lambda robot: cmath.phase(rays[robot]))
        share = 2 * math.pi / len(order)
        # Equal gaps in the order in which they stand, turned as little as may be for all of them.
        turn = cmath.phase(
            sum(cmath.rect(1, cmath.phase(rays[r]) - k * share) for k, r in enumerate(order))
        )
        angle = turn + order.index(self.me) * share
        say = {"share": {"bearing_rad": angle, "of": len(order)}}
        near = all(abs(ray) <= NEAR * ring for ray in rays.values())
        near = near and not any(self.waiting.get(robot) for robot in places)
        if near and widest_gap(rays.values()) <= 2 * math.pi - WIDE_RAD:
            touching = parameters["radius_m"] + parameters["target_radius_m"]
            goal = self.target_in(1) + cmath.rect(touching + KEEP_M, angle)
            return "shrink", goal, target, list(places), say
        goal = self.target_in(LEAD_TICKS) + cmath.rect(ring, angle)
        return "encircle", goal, target, list(places), say

    def clear(self, step, here, seen, target):
        """The step, no longer than it can be made, and not into anything but the target."""
        parameters = self.setup["parameters"]
        radius, longest = parameters["radius_m"], parameters["step_m_max"]
        step *= min(1.0, longest / abs(step)) if step else 0.0
        limits = []
        for _, x, y in seen["seen"]:
            way = complex(x, y) - here
            limits.append((way, (abs(way) - 2 * radius - KEEP_M) / 2))  # the other has half of it
        known = [complex(x, y) for _, x, y in seen["seen"]] + ([] if target is None else [target])
        for m, distance in enumerate(seen["scan"]):
            way = cmath.rect(distance, 2 * math.pi * m / len(seen["scan"]))
            near = distance < radius + KEEP_M + longest
            if near and all(abs(here + way - place) > radius + 0.3 for place in known):
                limits.append((way, distance - radius - KEEP_M))
        for way, limit in limits:
            direction = way / abs(way) if way else 1.0
            towards = (step * direction.conjugate()).real
            step -= direction * max(0.0, towards - max(0.0, limit))
        return step


def widest_gap(rays):
    angles = sorted(cmath.phase(ray) for ray in rays)
    after = [*angles[1:], angles[0] + 2 * math.pi]
    return max(b - a for a, b in zip(angles, after, strict=True))


def pair(number):
    return [number.real, number.imag]


def settings(endpoint):
    config = zenoh.Config()
    for name, value in {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 30_000,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }.items():
        config.insert_json5(name, json.dumps(value))
    return config


def main(me, run, endpoint):
    robot, base = Robot(me, run), f"encircle/{run}/robots/{me}"
    world_alive = f"encircle/{run}/world/alive"
    with zenoh.open(settings(endpoint)) as session:
        mail, life = queue.Queue(), session.liveliness()
        hand_over = zenoh.handlers.Callback(mail.put, indirect=False)
        kept = [
            session.declare_subscriber(
                f"{base}/*", hand_over, allowed_origin=zenoh.Locality.REMOTE
            ),
            life.declare_subscriber(world_alive, hand_over, history=True),
        ]
        out = {
            (channel, again): session.declare_publisher(
                f"{base}/{channel}",
                express=True,
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.INTERACTIVE_LOW if again else zenoh.Priority.DATA_HIGH,
            )
            for channel in ("pose", "command")
            for again in (False, True)
        }
        said = []
        kept.append(life.declare_token(f"{base}/alive"))
        deadline = time.monotonic() + JOIN_S
        while robot.ended is None:
            try:
                left = None if deadline is None else max(0.0, deadline - time.monotonic())
                sample = mail.get(timeout=left)
            except queue.Empty:
                print(f"{me}: no world", file=sys.stderr)
                return 1
            key = str(sample.key_expr)
            if key == world_alive:
                gone = sample.kind == zenoh.SampleKind.DELETE
                deadline = time.monotonic() + WORLD_AWAY_S if gone else deadline
            if not key.startswith(f"{base}/"):  # whatever matches it and is another, as ** does
                continue
            channel, refused = key.removeprefix(f"{base}/"), dict(robot.refused)
            answer = robot.hear(channel, sample.payload.to_bytes())
            for where, payload in answer:
                out[where, answer is said].put(payload)
            said = answer or said
            if robot.setup is not None and robot.refused == refused:
                deadline = None
    print(f"{me}: {robot.ended}")
    return 0 if robot.ended in ("captured", "ticks") else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
