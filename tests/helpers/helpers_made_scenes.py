"""Scenes made by hand: what is where is known, without any run."""

from dataclasses import replace

from encircle.scene.builder import Scene
from encircle.scene.frame import Frame, Packet, Values
from encircle.scene.stage import Stage

CAUSES = ("none", "loss", "burst-loss", "sender-silent")


def made_stage(robots=2, **changes):
    """A stage of robots r1, r2, ... with ticks of 0.1 s."""
    names = tuple(f"r{k + 1}" for k in range(robots))
    stage = Stage(
        run="made",
        title="Made by hand",
        seed=1,
        tick_s=0.1,
        ticks_max=100,
        clock="lockstep",
        robots=names,
        policies=("xi-star",) * robots,
        radius_m=0.5,
        target_radius_m=0.5,
        obstacles=(),
        sensing_ranges_m=(10.0,) * robots,
        stop_distance_m=1.0,
        capture_count=robots,
        behaviour="still",
        channel=("loss 50 % (bernoulli)", "no delay"),
        causes=CAUSES,
    )
    return replace(stage, **changes)


def made_frame(tick, robots, target, packets=(), **changes):
    """A frame in which robots stand at places in m, and nothing else happens."""
    count = len(robots)
    frame = Frame(
        tick=tick,
        robots=tuple(robots),
        headings_rad=(0.0,) * count,
        target=target,
        captured=False,
        contacts=(),
        lost=(False,) * count,
        silent=(False,) * count,
        modes=("search",) * count,
        xi=(None,) * count,
        points=(None,) * count,
        goals=(None,) * count,
        packets=tuple(Packet(*packet) for packet in packets),
        ages=tuple(tuple(0 if j == k else -1 for j in range(count)) for k in range(count)),
        beliefs=(None,) * count,
        beliefs_unsure=(),
        values=Values((1.0,) * count, 1.0, None, None, 0, None),
        events=(),
    )
    return replace(frame, **changes)


def standing_scene(packets_of_tick, ticks, robots=((0.0, 0.0), (12.0, 0.0)), target=(6.0, 5.0)):
    """A scene in which nobody moves; ``packets_of_tick``: (sender, receiver, due, copy due)."""
    frames = [
        made_frame(tick, robots, target, packets_of_tick.get(tick, ())) for tick in range(ticks + 1)
    ]
    return Scene(made_stage(len(robots)), tuple(frames), True)
