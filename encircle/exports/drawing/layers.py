"""What of a hunt is drawn in the field's viewers: entities of shapes, by layer.

Layers: ``arena`` (obstacles), ``bodies``, ``plan`` (goals, the lines to them, rings),
``packets``, and of each robot what it believes (``beliefs/r1``): where it takes its peers to be,
fading with age; its estimate of the target with the region in which it takes it to be with 95 %;
and the way that it expects it to go. Each layer of a frame is whole, so that a viewer which jumps
to any time shows the right thing. Viewers have a dark background more often than a light one, so
the colours are those of the palette's dark theme.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from functools import cache, partial
from math import cos, dist, log, pi, sin, sqrt

from encircle.exports.drawing.flights import Leg, style_of
from encircle.exports.drawing.shapes import (
    Colour,
    Disc,
    Entity,
    Label,
    Line,
    Point,
    Shape,
    colour_of,
    segments,
)
from encircle.scene.counts import counted
from encircle.scene.frame import PREDICTED_TICKS, Belief, Frame, PeerBelief
from encircle.scene.palette import DARK, robot_colour
from encircle.scene.stage import Stage

THIN_M, THICK_M = 0.08, 0.2
SIDES_PER_M, SIDES_MIN, SIDES_MAX = 12.0, 12, 64
"""A circle has sides by its radius: a team's ghosts are many, and small."""
CONFIDENCE = 0.95
REGION_SIGMAS = sqrt(-2.0 * log(1.0 - CONFIDENCE))
"""Radius, in standard deviations per axis, of the disc that holds a normal point in the plane with
that probability: 1 - exp(-r^2 / 2) of a Rayleigh distribution."""
FAINT_TICKS = 20.0
"""A ghost this old has faded to a third."""
MARK_M = 0.35
ORIGIN = (0.0, 0.0)
LABELLED_ROBOTS_MAX = 16
"""Ghosts of larger teams have neither labels nor outlines: there is no room for them."""
LOST_OPACITY, SILENT_OPACITY = 0.25, 0.6


def role_colour(role: str, opacity: float = 1.0) -> Colour:
    """The colour of a role in the palette."""
    return colour_of(DARK[role]).faded(opacity)


def colour_of_robot(robot: int, opacity: float = 1.0) -> Colour:
    """The colour of a robot by its place in the robot order."""
    return colour_of(robot_colour(robot)).faded(opacity)


def moving_layers(
    stage: Stage, frame: Frame, legs: Sequence[Leg]
) -> dict[str, Callable[[], tuple[Entity, ...]]]:
    """The layers of a frame by name, all but ``arena``, each drawn when it is called.

    ``legs``: of the packets on their way after the frame's tick.
    """
    drawn: dict[str, Callable[[], tuple[Entity, ...]]] = {
        "bodies": partial(bodies, stage, frame),
        "plan": partial(plan, stage, frame),
        "packets": partial(packets, legs),
    }
    for k, robot in enumerate(stage.robots):
        drawn[f"beliefs/{robot}"] = partial(beliefs, stage, frame, k)
    return drawn


def arena(stage: Stage) -> tuple[Entity, ...]:
    """The obstacles."""
    return tuple(
        Entity(f"obstacle-{k}", (Disc((x, y), radius_m, role_colour("obstacle")),))
        for k, (x, y, radius_m) in enumerate(stage.obstacles, 1)
    )


def bodies(stage: Stage, frame: Frame) -> tuple[Entity, ...]:
    """Robots with their headings and names, and the target with the stop distance around it.

    A lost robot is faint, and a silent one paler than the others; their labels say so.
    """
    things = []
    for k, name in enumerate(stage.robots):
        lost, silent = frame.lost[k], frame.silent[k]
        opacity = LOST_OPACITY if lost else SILENT_OPACITY if silent else 1.0
        text = f"{name} lost" if lost else f"{name} silent" if silent else name
        centre, radius_m = frame.robots[k], stage.radius_m
        front = _at(centre, frame.headings_rad[k], radius_m)
        shapes = (
            Disc(centre, radius_m, colour_of_robot(k, opacity), 0.3),
            Line((centre, front), role_colour("ink"), THIN_M, z_m=0.4),
            Label(_above(centre, radius_m), text, 0.8, role_colour("ink"), 0.5),
        )
        things.append(Entity(name, shapes))
    return (*things, _target(stage, frame))


def _target(stage: Stage, frame: Frame) -> Entity:
    text = "target captured" if frame.captured else "target"
    shapes = (
        Disc(frame.target, stage.target_radius_m, role_colour("target"), 0.3),
        circle(frame.target, stage.stop_distance_m, role_colour("target", 0.6), THIN_M),
        Label(_above(frame.target, stage.target_radius_m), text, 0.8, role_colour("ink"), 0.5),
    )
    return Entity("target", shapes)


def outlines(stage: Stage, frame: Frame) -> tuple[Entity, ...]:
    """Where the bodies really are, beside what a robot believes: a thin circle for each."""
    named = zip((*stage.robots, "target"), (*frame.robots, frame.target), strict=True)
    radii_m = {"target": stage.target_radius_m}
    return tuple(
        Entity(
            name,
            (circle(centre, radii_m.get(name, stage.radius_m), role_colour("ink"), THIN_M, 0.6),),
        )
        for name, centre in named
    )


def plan(stage: Stage, frame: Frame) -> tuple[Entity, ...]:
    """Of each robot with a goal: the goal, the line to it, and the ring that it is a point of."""
    things = []
    for k, (name, goal) in enumerate(zip(stage.robots, frame.goals, strict=True)):
        if goal is None:
            continue
        colour = colour_of_robot(k)
        shapes = [
            circle(goal, MARK_M, colour, THIN_M, 0.2),
            Line((frame.robots[k], goal), colour.faded(0.7), THIN_M, z_m=0.1),
        ]
        if (ring := ring_of(frame, k)) is not None:
            shapes.append(circle(*ring, colour.faded(0.4), THIN_M))
        things.append(Entity(name, tuple(shapes)))
    return tuple(things)


def packets(legs: Sequence[Leg]) -> tuple[Entity, ...]:
    """The legs of packets by fate, with a mark where one arrives or was lost."""
    by_fate: dict[str, list[Leg]] = {}
    for leg in legs:
        by_fate.setdefault(leg.fate, []).append(leg)
    return tuple(Entity(fate, _of_fate(fate, by_fate[fate])) for fate in sorted(by_fate))


def _of_fate(fate: str, legs: Sequence[Leg]) -> tuple[Shape, ...]:
    style = style_of(fate)
    colour = role_colour(style.role)
    ways = segments([(leg.start, leg.end) for leg in legs], colour.faded(0.5), THIN_M, 0.15)
    marks = [piece for leg in legs for piece in mark(style.shape, leg.end)]
    return ways + segments(marks, colour, THIN_M, 0.2)


def beliefs(stage: Stage, frame: Frame, robot: int) -> tuple[Entity, ...]:
    """The world as one robot believes it to be; nothing if that is not known."""
    belief = frame.beliefs[robot]
    if belief is None:
        return ()
    things = [_ghost(stage, peer) for peer in belief.peers]
    return (*things, *_believed_target(stage, belief, robot))


def _believed_target(stage: Stage, belief: Belief, robot: int) -> tuple[Entity, ...]:
    if belief.estimate is None:
        return ()
    x, y = belief.estimate[:2]
    colour = colour_of_robot(robot)
    shapes: list[Shape] = [
        circle((x, y), stage.target_radius_m, colour, THICK_M, 0.5),
        Label(_above((x, y), stage.target_radius_m), "target as believed", 0.5, colour, 0.5),
    ]
    if belief.covariance is not None:
        radius_m = REGION_SIGMAS * sqrt(belief.covariance[0])
        shapes.append(Disc((x, y), radius_m, colour.faded(0.2), 0.1))
    if belief.prediction:
        shapes.append(Line(((x, y), *belief.prediction), colour.faded(0.8), THIN_M, z_m=0.4))
    return (Entity("target", tuple(shapes)),)


def circle(
    centre: Point, radius_m: float, colour: Colour, width_m: float, z_m: float = 0.05
) -> Line:
    """A circle as a closed line."""
    sides = round(min(max(SIDES_MIN, SIDES_PER_M * radius_m), SIDES_MAX))
    angles = [2.0 * pi * k / sides for k in range(sides)]
    return Line(tuple([_at(centre, a, radius_m) for a in angles]), colour, width_m, True, z_m)


def mark(shape: str, centre: Point) -> list[tuple[Point, Point]]:
    """A mark of a shape that the palette names, as pieces of lines, ``MARK_M`` wide in m."""
    x, y = centre
    return [((x + a, y + b), (x + c, y + d)) for (a, b), (c, d) in _mark_at_origin(shape)]


@cache
def _mark_at_origin(shape: str) -> tuple[tuple[Point, Point], ...]:
    quarter, corners = pi / 2.0, [pi / 4.0 + k * pi / 2.0 for k in range(4)]
    arms = {
        "x": corners,
        "plus": [k * quarter for k in range(4)],
        "star": [quarter + k * pi / 3.0 for k in range(6)],
        "bar": [quarter, -quarter],
        "ring-x": corners,
        "box-x": corners,
    }.get(shape, [])
    outline = {
        "disc": [k * pi / 3.0 for k in range(6)],
        "diamond": [k * quarter for k in range(4)],
        "ring-x": [k * pi / 4.0 for k in range(8)],
        "box-x": corners,
    }.get(shape, [])
    ends = [_at(ORIGIN, angle, MARK_M / 2.0) for angle in outline]
    sides = zip(ends, [*ends[1:], *ends[:1]], strict=True)
    return (*((ORIGIN, _at(ORIGIN, angle, MARK_M / 2.0)) for angle in arms), *sides)


def _at(centre: Point, angle_rad: float, distance_m: float) -> Point:
    return (centre[0] + distance_m * cos(angle_rad), centre[1] + distance_m * sin(angle_rad))


def _above(centre: Point, radius_m: float) -> Point:
    return (centre[0], centre[1] + radius_m + 0.6)


def _ghost(stage: Stage, peer: PeerBelief) -> Entity:
    """Where a robot takes a peer to be: a circle that fades with age, filled if planned with.

    In a large team a disc, fainter if it is not planned with.
    """
    name = stage.robots[peer.robot]
    opacity = 3.0 ** (-peer.age_ticks / FAINT_TICKS)
    colour = colour_of_robot(peer.robot, opacity)
    centre = (peer.x, peer.y)
    if len(stage.robots) > LABELLED_ROBOTS_MAX:
        faint = colour.faded(opacity * (0.6 if peer.planned_with else 0.25))
        return Entity(name, (Disc(centre, stage.radius_m, faint, 0.2),))
    shapes: list[Shape] = [circle(centre, stage.radius_m, colour, THIN_M, 0.45)]
    if peer.planned_with:
        shapes.append(Disc(centre, stage.radius_m, colour.faded(0.4 * opacity), 0.2))
    below = (peer.x, peer.y - stage.radius_m - 0.6)
    text = f"{name}, {counted(peer.age_ticks, 'tick')}"
    shapes.append(Label(below, text, 0.5, role_colour("muted"), 0.5))
    return Entity(name, tuple(shapes))


def ring_of(frame: Frame, robot: int) -> tuple[Point, float] | None:
    """Centre and radius in m of the ring that a robot's goal is a point of; None without one.

    The ring is around the place at which the robot expects the target to be after the prediction
    step that it has chosen. A belief holds that place for some steps; it is taken to lie on a
    straight line in between.
    """
    goal, xi, belief = frame.goals[robot], frame.xi[robot], frame.beliefs[robot]
    if goal is None or xi is None or frame.points[robot] is None or belief is None:
        return None
    if belief.estimate is None or not 0.0 <= xi <= PREDICTED_TICKS[-1]:
        return None
    ticks = (0.0, *PREDICTED_TICKS)
    places = (belief.estimate[:2], *belief.prediction)
    after = max(1, bisect_left(ticks, xi))
    share = (xi - ticks[after - 1]) / (ticks[after] - ticks[after - 1])
    (x, y), (next_x, next_y) = places[after - 1], places[after]
    centre = (x + share * (next_x - x), y + share * (next_y - y))
    return centre, dist(centre, goal)
