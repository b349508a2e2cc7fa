"""The world as one robot believes it, drawn over the truth, which is pale then."""

from math import exp, sqrt

from encircle.exports.pictures.arena import ArenaPainter
from encircle.exports.pictures.canvas import XY
from encircle.exports.pictures.moment import Moment
from encircle.scene.frame import Belief, PeerBelief
from encircle.scene.palette import robot_colour

FADING_TICKS = 12.0
"""A ghost of this age has faded to 1/e."""
ALPHA_MIN = 0.3
ELLIPSE_CHI2 = 5.991
"""The 95 % quantile of chi-square with two degrees of freedom: of x and y together."""


def draw_belief(painter: ArenaPainter, moment: Moment, believer: int, belief: Belief) -> None:
    """Peers where the robot takes them to be, its estimate of the target, and its prediction.

    Ghosts fade with the age of what is known, which stands beside their names in s; a thin
    line leads to where the peer really is. The circle around the estimate holds the target with
    95 % if the robot's covariance is right; its axes have equal variances by the model.
    """
    sheet, camera = painter.sheet, painter.camera
    for peer in belief.peers:
        _ghost(painter, peer, camera.at(moment.robots[peer.robot]))
    own, colour = camera.at(belief.position), robot_colour(believer)
    sheet.canvas.disc(own, painter.radius, colour, sheet.colours["ink"], 2.4 * sheet.unit)
    if belief.estimate is not None:
        _estimate(painter, belief, camera.at(belief.estimate[:2]))
    # Over all bodies: names are short, and without them ghosts are nobody's.
    _name(painter, own, sheet.stage.robots[believer], bold=True)
    for peer in belief.peers:
        age_s = peer.age_ticks * sheet.stage.tick_s
        age = f" {age_s:.2g} s old" if peer.age_ticks else ""
        _name(painter, camera.at((peer.x, peer.y)), f"{sheet.stage.robots[peer.robot]}{age}")


def _ghost(painter: ArenaPainter, peer: PeerBelief, truth: XY) -> None:
    """A peer where it is taken to be; hollow if the robot does not plan with it."""
    canvas, unit, colour = painter.sheet.canvas, painter.sheet.unit, robot_colour(peer.robot)
    at, alpha = painter.camera.at((peer.x, peer.y)), exp(-peer.age_ticks / FADING_TICKS)
    canvas.line([at, truth], colour, unit, 0.8, (unit, 3 * unit))
    fill = colour if peer.planned_with else ""
    canvas.disc(at, painter.radius, fill, colour, 2.0 * unit, max(ALPHA_MIN, alpha))


def _name(painter: ArenaPainter, at: XY, text: str, bold: bool = False) -> None:
    letters, ink = painter.sheet.letters, painter.sheet.colours["ink"]
    below = (at[0], at[1] + painter.radius + 0.8 * letters)
    painter.sheet.canvas.text(text, below, 0.85 * letters, ink, "centre", bold, halo=True)


def _estimate(painter: ArenaPainter, belief: Belief, at: XY) -> None:
    """A cross at the estimate, the circle that holds the target, and where it is to go."""
    canvas, unit, colour = painter.sheet.canvas, painter.sheet.unit, painter.sheet.colours["target"]
    if belief.covariance is not None:
        spread_m = sqrt(ELLIPSE_CHI2 * max(belief.covariance[0], 0.0))
        spread = spread_m * painter.camera.pixels_per_m
        canvas.disc(at, spread, colour, alpha=0.10)
        canvas.disc(at, spread, "", colour, 1.4 * unit, 0.8, (7 * unit, 4 * unit))
    if belief.prediction:
        ahead = [at, *(painter.camera.at(place) for place in belief.prediction)]
        canvas.line(ahead, colour, 1.8 * unit, 0.9, (2 * unit, 4 * unit))
    arm = max(7.0 * unit, 0.5 * painter.radius)
    canvas.line([(at[0] - arm, at[1]), (at[0] + arm, at[1])], colour, 2.2 * unit)
    canvas.line([(at[0], at[1] - arm), (at[0], at[1] + arm)], colour, 2.2 * unit)
