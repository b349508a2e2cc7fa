"""Labels and a legend on a map that is drawn, so that they cover as little of it as can be.

All is measured in points from the figure's lower left corner. The axes have their place and scale
already, and are moved only to make room for a legend outside.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Annotation
from matplotlib.transforms import BboxBase

from encircle.figures.drawing import note
from encircle.figures.label_placement import Box, Floats, Page, along, free_corner

LABEL_PT, GAP_PT = 6.0, 3.5
INK_STEP_PT = 2.0
LETTER_EM, HEIGHT_EM = 0.66, 0.95
"""Of digits and letters, rather more than less."""
MARKER_PT_MIN = 4.5
"""Labels go over smaller ones, if need be."""
LEGEND_GAP_IN = 0.06
POINTS_PER_IN = 72.0


class Label(NamedTuple):
    """A short text beside a place (2,) in data units."""

    text: str
    position: Floats
    colour: str


def add_labels(axes: Axes, labels: Iterable[Label]) -> None:
    """Put labels beside their places, those that matter most first; without room, none."""
    page = page_of(axes)
    for label in labels:
        x, y = to_points(axes, label.position).tolist()
        box = page.put((x, y), _size(label.text, LABEL_PT), GAP_PT)
        if box is not None:
            offset = ((box[0] + box[2]) / 2.0 - x, (box[1] + box[3]) / 2.0 - y)
            note(axes, label.text, label.position.tolist(), offset, LABEL_PT, label.colour)


def add_legend(figure: Figure, axes: Axes, handles: Sequence[Artist]) -> None:
    """In a corner of the axes where nothing is, or beside high axes, or below wide ones."""
    width, height = _legend_in(axes, handles, 1)
    room = POINTS_PER_IN * (width + LEGEND_GAP_IN), POINTS_PER_IN * (height + LEGEND_GAP_IN)
    corner: Any = free_corner(page_of(axes), room)
    if corner is not None:
        axes.legend(handles=handles, loc=corner, borderaxespad=0.3)
        return
    across, up = figure.get_size_inches().tolist()
    left, low, wide, high = (axes.get_position().bounds * np.array([across, up] * 2)).tolist()
    how: dict[str, Any]
    if high > wide:
        beside = left + wide + LEGEND_GAP_IN
        across = max(across, beside + width + LEGEND_GAP_IN)
        how = {"loc": "upper left", "bbox_to_anchor": (beside, low + high)}
    else:
        columns = max(
            (n for n in range(2, len(handles) + 1) if _legend_in(axes, handles, n)[0] < across),
            default=1,
        )
        taken = _legend_in(axes, handles, columns)[1] + LEGEND_GAP_IN
        low, up = low + taken, up + taken
        below = (across / 2.0, LEGEND_GAP_IN)
        how = {"loc": "lower center", "bbox_to_anchor": below, "ncols": columns}
    figure.set_size_inches(across, up)
    axes.set_position((left / across, low / up, wide / across, high / up))
    figure.legend(handles=handles, borderaxespad=0.0, bbox_transform=figure.dpi_scale_trans, **how)


def _legend_in(axes: Axes, handles: Sequence[Artist], columns: int) -> tuple[float, float]:
    """Width and height in inches that a legend would have."""
    figure: Any = axes.figure
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    legend = axes.legend(handles=handles, ncols=columns)
    box = legend.get_window_extent(renderer)
    legend.remove()
    return box.width / figure.dpi, box.height / figure.dpi


def page_of(axes: Axes) -> Page:
    """What has been drawn so far, and the place that there is."""
    lines = [(line, to_points(axes, np.asarray(line.get_xydata()))) for line in axes.lines]
    ink = [places for line, places in lines if line.get_linestyle() != "None"]
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    rim = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    discs = [patch for patch in axes.patches if isinstance(patch, Circle)]
    ink += [to_points(axes, np.array(disc.center) + disc.radius * rim) for disc in discs]
    left, low, right, high = _in_points(axes, axes.bbox)
    page = Page((left + 1.0, low + 1.0, right - 1.0, high - 1.0), along(ink, INK_STEP_PT))
    for line, places in lines:
        size = line.get_markersize()
        if line.get_marker() != "None" and size >= MARKER_PT_MIN:
            marked = places if line.get_markevery() is None else places[:1]
            page.taken.extend(_box(position, (size, size)) for position in marked)
    for text in axes.texts:
        assert isinstance(text, Annotation)
        centre = to_points(axes, np.array(text.xy)) + text.get_position()
        page.taken.append(_box(centre, _size(text.get_text().strip("${}"), text.get_fontsize())))
    legend = axes.get_legend()
    if legend is not None:
        page.taken.append(_in_points(axes, legend.get_window_extent()))
    return page


def _in_points(axes: Axes, box: BboxBase) -> Box:
    """A box in pixels as one in points."""
    points = np.array([box.x0, box.y0, box.x1, box.y1]) * POINTS_PER_IN / axes.figure.dpi
    left, low, right, high = points.tolist()
    return left, low, right, high


def to_points(axes: Axes, places: Floats) -> Floats:
    """Places in data units, (2,) or (M, 2), as points on the figure."""
    points: Floats = axes.transData.transform(places) * POINTS_PER_IN / axes.figure.dpi
    return points


def _box(centre: Floats, size: tuple[float, float]) -> Box:
    (x, y), (width, height) = centre.tolist(), size
    return x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0


def _size(text: str, size_pt: Any) -> tuple[float, float]:
    """Width and height of a text in points."""
    return LETTER_EM * size_pt * len(text), HEIGHT_EM * size_pt
