"""Labels and a legend on a finished map, placed where they cover as little as possible.

Lengths are in typographic points from the lower left corner of the figure. The axes already have
their position and scale; they are moved only to make room for a legend outside of them. The search
for a free position is in ``encircle.figures.label_placement``.
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

from encircle.figures.drawing import draw_text
from encircle.figures.label_placement import Box, Floats, LabelCanvas, free_corner, points_along

LABEL_PT, GAP_PT = 6.0, 3.5
INK_STEP_PT = 2.0
LETTER_WIDTH_EM, LETTER_HEIGHT_EM = 0.66, 0.95
"""Mean width and height of letters and digits, as a share of the font size; rather too large."""
MARKER_PT_MIN = 4.5
"""Labels may cover smaller markers."""
LEGEND_GAP_IN = 0.06
POINTS_PER_IN = 72.0


class Label(NamedTuple):
    """A short text beside a position (2,) in data units."""

    text: str
    position: Floats
    colour: str


def add_labels(axes: Axes, labels: Iterable[Label]) -> None:
    """Add labels beside their positions, in order of importance; without a free box, none."""
    canvas = canvas_of(axes)
    for label in labels:
        x, y = to_figure_points(axes, label.position).tolist()
        box = canvas.place((x, y), _text_size(label.text, LABEL_PT), GAP_PT)
        if box is not None:
            offset = ((box[0] + box[2]) / 2.0 - x, (box[1] + box[3]) / 2.0 - y)
            draw_text(axes, label.text, label.position.tolist(), offset, LABEL_PT, label.colour)


def add_legend(figure: Figure, axes: Axes, handles: Sequence[Artist]) -> None:
    """Add a legend in a free corner of the axes, beside high axes, or below wide ones."""
    width, height = _legend_size_in(axes, handles, 1)
    size_pt = POINTS_PER_IN * (width + LEGEND_GAP_IN), POINTS_PER_IN * (height + LEGEND_GAP_IN)
    corner: Any = free_corner(canvas_of(axes), size_pt)
    if corner is not None:
        axes.legend(handles=handles, loc=corner, borderaxespad=0.3)
        return
    across, up = figure.get_size_inches().tolist()
    left, low, wide, high = (axes.get_position().bounds * np.array([across, up] * 2)).tolist()
    location: dict[str, Any]
    if high > wide:
        beside = left + wide + LEGEND_GAP_IN
        across = max(across, beside + width + LEGEND_GAP_IN)
        location = {"loc": "upper left", "bbox_to_anchor": (beside, low + high)}
    else:
        columns = max(
            (
                n
                for n in range(2, len(handles) + 1)
                if _legend_size_in(axes, handles, n)[0] < across
            ),
            default=1,
        )
        legend_in = _legend_size_in(axes, handles, columns)[1] + LEGEND_GAP_IN
        low, up = low + legend_in, up + legend_in
        below = (across / 2.0, LEGEND_GAP_IN)
        location = {"loc": "lower center", "bbox_to_anchor": below, "ncols": columns}
    figure.set_size_inches(across, up)
    axes.set_position((left / across, low / up, wide / across, high / up))
    figure.legend(
        handles=handles, borderaxespad=0.0, bbox_transform=figure.dpi_scale_trans, **location
    )


def _legend_size_in(axes: Axes, handles: Sequence[Artist], columns: int) -> tuple[float, float]:
    """Width and height in inches that a legend with so many columns would have."""
    figure: Any = axes.figure
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    legend = axes.legend(handles=handles, ncols=columns, loc="upper left")
    box = legend.get_window_extent(renderer)
    legend.remove()
    return box.width / figure.dpi, box.height / figure.dpi


def canvas_of(axes: Axes) -> LabelCanvas:
    """The canvas of some axes: points on what is drawn so far, and boxes that are occupied."""
    lines = [(line, to_figure_points(axes, np.asarray(line.get_xydata()))) for line in axes.lines]
    ink = [positions for line, positions in lines if line.get_linestyle() != "None"]
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    rim = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    discs = [patch for patch in axes.patches if isinstance(patch, Circle)]
    ink += [to_figure_points(axes, np.array(disc.center) + disc.radius * rim) for disc in discs]
    left, low, right, high = _box_in_points(axes, axes.bbox)
    canvas = LabelCanvas(
        (left + 1.0, low + 1.0, right - 1.0, high - 1.0), points_along(ink, INK_STEP_PT)
    )
    for line, positions in lines:
        size = line.get_markersize()
        if line.get_marker() != "None" and size >= MARKER_PT_MIN:
            marked = positions if line.get_markevery() is None else positions[:1]
            canvas.occupied.extend(_box_around(position, (size, size)) for position in marked)
    for text in axes.texts:
        assert isinstance(text, Annotation)
        centre = to_figure_points(axes, np.array(text.xy)) + text.get_position()
        canvas.occupied.append(
            _box_around(centre, _text_size(text.get_text().strip("${}"), text.get_fontsize()))
        )
    legend = axes.get_legend()
    if legend is not None:
        canvas.occupied.append(_box_in_points(axes, legend.get_window_extent()))
    return canvas


def _box_in_points(axes: Axes, box: BboxBase) -> Box:
    """Convert a box in pixels to one in points."""
    points = np.array([box.x0, box.y0, box.x1, box.y1]) * POINTS_PER_IN / axes.figure.dpi
    left, low, right, high = points.tolist()
    return left, low, right, high


def to_figure_points(axes: Axes, positions: Floats) -> Floats:
    """Convert positions in data units, (2,) or (M, 2), to points on the figure."""
    points: Floats = axes.transData.transform(positions) * POINTS_PER_IN / axes.figure.dpi
    return points


def _box_around(centre: Floats, size: tuple[float, float]) -> Box:
    (x, y), (width, height) = centre.tolist(), size
    return x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0


def _text_size(text: str, size_pt: Any) -> tuple[float, float]:
    """Estimated width and height of a text in points."""
    return LETTER_WIDTH_EM * size_pt * len(text), LETTER_HEIGHT_EM * size_pt
