"""The world as one robot believes it, drawn over the truth, which is pale then."""

from math import exp, sqrt

from encircle.exports.pictures.arena import ArenaPainter
from encircle.exports.pictures.moment import Moment
from encircle.scene.frame import Belief
from encircle.scene.palette import robot_colour

FADING_TICKS = 12.0
"""A ghost of this age has faded to 1/e."""
ALPHA_MIN = 0.3
ELLIPSE_CHI2 = 5.991
"""The 95 % quantile of chi-square with two degrees of freedom: of x and y together."""


def draw_belief(painter: ArenaPainter, moment: Moment, believer: int, belief: Belief) -> None:
    """Peers where the robot takes them to be, its estimate of the target, and its prediction.

    Ghosts fade with the age of what is known, which stands beside their names in ticks; a thin
    line leads to where the peer really is. The circle around the estimate holds the target with
    95 % if the robot's covariance is right; its axes have equal variances by the model.
    """
    sheet, camera, radius = painter.sheet, painter.camera, painter.radius
    canvas, stage, unit, letters = sheet.canvas, sheet.stage, sheet.unit, sheet.letters
    for peer in belief.peers:
        at, colour = camera.at((peer.x, peer.y)), robot_colour(peer.robot)
        alpha = max(ALPHA_MIN, exp(-peer.age_ticks / FADING_TICKS))
        truth = camera.at(moment.robots[peer.robot])
        canvas.line([at, truth], colour, unit, 0.8, (unit, 3 * unit))
        fill = colour if peer.planned_with else ""
        canvas.disc(at, radius, fill, colour, 2.0 * unit, alpha)
        age = f" {peer.age_ticks * stage.tick_s:.2g} s old" if peer.age_ticks else ""
        text = f"{stage.robots[peer.robot]}{age}"
        below = (at[0], at[1] + radius + 0.8 * letters)
        canvas.text(text, below, 0.85 * letters, sheet.colours["ink"], "centre", halo=True)
    own = camera.at(belief.position)
    canvas.disc(own, radius, robot_colour(believer), sheet.colours["ink"], 2.4 * unit)
    name, size = stage.robots[believer], min(letters, 0.9 * radius)
    if radius >= 0.95 * letters:
        canvas.text(name, own, size, sheet.colours["ink"], "centre", True, True)
    if belief.estimate is None:
        return
    x, y = belief.estimate[:2]
    at, colour = camera.at((x, y)), sheet.colours["target"]
    if belief.covariance is not None:
        spread_m = sqrt(ELLIPSE_CHI2 * max(belief.covariance[0], 0.0))
        spread = spread_m * camera.pixels_per_m
        canvas.disc(at, spread, colour, alpha=0.10)
        canvas.disc(at, spread, "", colour, 1.4 * unit, 0.8, (7 * unit, 4 * unit))
    if belief.prediction:
        ahead = [at, *(camera.at(place) for place in belief.prediction)]
        canvas.line(ahead, colour, 1.8 * unit, 0.9, (2 * unit, 4 * unit))
    arm = max(7.0 * unit, 0.5 * radius)
    canvas.line([(at[0] - arm, at[1]), (at[0] + arm, at[1])], colour, 2.2 * unit)
    canvas.line([(at[0], at[1] - arm), (at[0], at[1] + arm)], colour, 2.2 * unit)
