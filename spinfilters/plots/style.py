"""Figure style: colours for colour-blind readers, a line per estimator, saving."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int
from matplotlib import __version__ as matplotlib_version
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.io.input_file import reason
from spinfilters.io.output_files import write_bytes
from spinfilters.plots.png_file import png_bytes

BLUE: Final[str] = "#0072B2"
RED: Final[str] = "#D55E00"
GREEN: Final[str] = "#009E73"
PURPLE: Final[str] = "#CC79A7"
SKY: Final[str] = "#56B4E9"
ORANGE: Final[str] = "#E69F00"
BLACK: Final[str] = "#222222"
GREY: Final[str] = "#8A8A8A"
"""Colours of Okabe and Ito."""

AXIS_COLOURS: Final[tuple[str, str, str]] = ("#332288", "#999933", "#882255")
"""Of the first, second and third axis of a frame where one panel holds all three; none is an estimator's (Tol's muted scheme)."""
PRINCIPAL_NAMES: Final[tuple[str, str, str]] = ("minor", "intermediate", "major")
"""Principal axes in the ascending order of their moments."""
INITIALISATION: Final[str] = "initialisation (smoothed)"
"""What the epochs are called that a smoother made for the filters to begin from."""
SIGMAS: Final[float] = 3.0
"""Half width of every band, in standard deviations."""
ONE_DRAWS: Final = threading.RLock()
"""Held while matplotlib works: its parser of formulas, fonts and settings belong to the whole process."""
_RESERVED = {"mekf": BLUE, "ukf": RED}
_OTHERS = (GREEN, PURPLE, ORANGE, SKY)
_DASHES: Final[tuple[tuple[float, tuple[float, ...]], ...]] = (
    (0.0, ()),
    (0.0, (4.0, 2.0)),
    (0.0, (1.0, 1.5)),
    (0.0, (6.0, 1.5, 1.0, 1.5)),
)
MOST_DRAWN: Final[int] = 8000
"""Points of a curve: four times as many as a picture has columns."""
_DPI = 150
_DRAWN_BY: Final = f"Matplotlib version{matplotlib_version}, https://matplotlib.org/"
LETTERS: Final[dict[Any, Any]] = {"text.hinting": "none"}
"""Settings of matplotlib for pixels. Hints move outlines to whole pixels, for screens that are coarser than these pictures. Text
takes six tenths of the time without."""
_MAKE_TICKS: Final = "_update_ticks"
"""Method of an axis that makes its ticks."""
_MEASURE_LABELS: Final = "_get_ticklabel_bboxes"
"""Method of an axis that measures the labels of ticks."""
_LETTER_INCHES, _HANDLE_INCHES = 0.078, 0.75  # of a legend's entries at the default font size


_RANDOM: Final[dict[str, Any]] = {"linewidth": 0.7, "linestyle": ":"}


@dataclass(frozen=True)
class EstimatorLine:
    """Line style of one estimator in every panel of a figure.

    Attributes
    ----------
    name : str
        Of the estimator.
    color : str
        Of its lines and bands.
    dashes : tuple
        Offset and lengths, in widths of the line, as matplotlib takes them.
    width : float
        Of the line, points.
    """

    name: str
    color: str
    dashes: tuple[float, tuple[float, ...]]
    width: float

    def draw(self, axes: Axes, time: np.ndarray, values: np.ndarray) -> None:
        """A course over time.

        Parameters
        ----------
        axes : Axes
            Axes to draw into.
        time : ndarray
            Times, s.
        values : ndarray
            Values at these times.
        """
        rows = extremes(values)
        axes.plot(time[rows], values[rows], color=self.color, linestyle=self.dashes, linewidth=self.width)

    def fill(self, axes: Axes, time: np.ndarray, centre: np.ndarray, half: np.ndarray) -> None:
        """A translucent band.

        Parameters
        ----------
        axes : Axes
            Axes to draw into.
        time : ndarray
            Times, s.
        centre : ndarray
            Middle of the band.
        half : ndarray
            Its half width.
        """
        fill_band(axes, time, centre, half, self.color)

    def edge(self, axes: Axes, time: np.ndarray, centre: np.ndarray, half: np.ndarray) -> None:
        """Edges of a band without errors of the calibration.

        Parameters
        ----------
        axes : Axes
            Axes to draw into.
        time : ndarray
            Times, s.
        centre : ndarray
            Middle of the band.
        half : ndarray
            Its half width.
        """
        for curve in (centre - half, centre + half):
            rows = extremes(curve)
            axes.plot(time[rows], curve[rows], color=self.color, **_RANDOM)

    @property
    def handle(self) -> Line2D:
        """Legend entry."""
        return Line2D(
            [], [], color=self.color, linestyle=self.dashes, linewidth=self.width, label=self.name.upper()
        )


def estimator_lines(names: Sequence[str]) -> list[EstimatorLine]:
    """Line styles of estimators that stay visible where they agree.

    Parameters
    ----------
    names : sequence of str
        Of the estimators, in the order of drawing.

    Returns
    -------
    list of EstimatorLine
        A colour, dashes and a width for each.
    """
    free = iter(_OTHERS * (1 + len(names) // len(_OTHERS)))
    return [
        EstimatorLine(
            name, _RESERVED.get(name) or next(free), _DASHES[k % len(_DASHES)], max(2.4 - 0.8 * k, 1.2)
        )
        for k, name in enumerate(names)
    ]


def extremes(*curves: np.ndarray) -> Int[np.ndarray, " k"] | slice:
    """Indices of curves that a picture can show: extremes of every stretch.

    Parameters
    ----------
    curves : ndarray
        Values at the same times.

    Returns
    -------
    ndarray of int, shape (k,) or slice
        Indices to draw, or all as a slice.
    """
    count = len(curves[0])
    if count <= MOST_DRAWN:
        return slice(None)
    starts = np.linspace(0, count, MOST_DRAWN // (2 * len(curves)), endpoint=False).astype(int)
    rows = [starts[:1], np.array([count - 1])]
    for curve in curves:
        for beyond, extreme in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            parts = np.split(np.where(np.isnan(curve), beyond, curve), starts[1:])  # a gap hides no peak
            rows.append(starts + [int(extreme(part)) for part in parts])
    return np.unique(np.concatenate(rows))


def fill_band(axes: Axes, time: np.ndarray, centre: np.ndarray, half: np.ndarray, color: str) -> None:
    """A translucent band of a half width about a course over time.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    time : ndarray
        Times, s.
    centre : ndarray
        Middle of the band.
    half : ndarray
        Its half width.
    color : str
        Colour of matplotlib.
    """
    low, high = centre - half, centre + half
    rows = extremes(low, high)
    axes.fill_between(time[rows], low[rows], high[rows], color=color, alpha=0.17, linewidth=0)


def mark_start(axes: Axes, first: float, end_of_initialisation: float | None) -> None:
    """Shade the times (s) of the filters' initialisation, from the first epoch on.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    first : float
        Time of the first epoch, s.
    end_of_initialisation : float or None
        Its end, s; None without one.
    """
    if end_of_initialisation is not None:
        axes.axvspan(first, end_of_initialisation, color=BLACK, alpha=0.07, linewidth=0, zorder=0)


def start_handle(end_of_initialisation: float | None) -> list[Artist]:
    """Legend entry of `mark_start`, none when there is no initialisation.

    Parameters
    ----------
    end_of_initialisation : float or None
        Its end, s; None without one.

    Returns
    -------
    list of Artist
        One entry, or none.
    """
    return [] if end_of_initialisation is None else [Patch(color=BLACK, alpha=0.1, label=INITIALISATION)]


def random_handle() -> Line2D:
    """Legend entry of `EstimatorLine.edge`.

    Returns
    -------
    Line2D
        For `legend_below`.
    """
    return Line2D([], [], color=BLACK, label="the same without errors of the calibration", **_RANDOM)


def truth_handle(label: str = "truth") -> Line2D:
    """Legend entry of `plot_truth`.

    Parameters
    ----------
    label : str
        Its text.

    Returns
    -------
    Line2D
        For `legend_below`.
    """
    return Line2D([], [], color=BLACK, linestyle=(0, (2, 1.5)), linewidth=1.3, label=label)


def dot_handles(colours: Mapping[str, str]) -> list[Artist]:
    """Legend entries of points.

    Parameters
    ----------
    colours : mapping of str to str
        Colours by the text of the entry.

    Returns
    -------
    list of Artist
        For `legend_below`.
    """
    return [
        Line2D([], [], linestyle="none", marker="o", color=colour, label=name)
        for name, colour in colours.items()
    ]


def plot_truth(axes: Axes, time: np.ndarray, values: np.ndarray) -> None:
    """The true course, as in `truth_handle`.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    time : ndarray
        Times, s.
    values : ndarray
        True values at these times.
    """
    rows = extremes(values)
    axes.plot(time[rows], values[rows], color=BLACK, linestyle=(0, (2, 1.5)), linewidth=1.3, zorder=4)


def legend_below(figure: Figure, handles: Sequence[Artist]) -> None:
    """One legend for the whole figure, under it, in as few rows as its width allows.

    Parameters
    ----------
    figure : Figure
        With the panels.
    handles : sequence of Artist
        Entries, in their order.
    """
    widths = [_HANDLE_INCHES + _LETTER_INCHES * len(str(handle.get_label())) for handle in handles]
    rows = 1
    while rows < len(widths) and _legend_width(widths, rows) > figure.get_figwidth():
        rows += 1
    columns = -(-len(widths) // rows)
    figure.legend(handles=list(handles), loc="outside lower center", ncols=columns, frameon=False)


def tidy(axes: Axes) -> None:
    """Grid and no box.

    Parameters
    ----------
    axes : Axes
        A panel.
    """
    axes.grid(alpha=0.3, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def finite_quantile(values: np.ndarray, share: float, otherwise: float = 0.0) -> float:
    """Quantile of the numbers that are finite.

    Parameters
    ----------
    values : ndarray
        Numbers, some perhaps not finite.
    share : float
        Of the finite numbers below the quantile, from 0 to 1.
    otherwise : float
        Result where none is finite.

    Returns
    -------
    float
        The quantile.
    """
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, share)) if finite.size else otherwise


def half_width(errors: Float[np.ndarray, "n k"], bands: Float[np.ndarray, "n k"]) -> float:
    """Half height of a panel with all errors and 90 % of the bands.

    Parameters
    ----------
    errors : ndarray of float, shape (n, k)
        Errors of k axes.
    bands : ndarray of float, shape (n, k)
        Half widths of their bands.

    Returns
    -------
    float
        In the unit of the errors.
    """
    width = max(finite_quantile(np.abs(errors), 1.0), finite_quantile(bands, 0.9))
    return 1.15 * width if width > 0 else 1.0


def draw_figure(draw: Callable[[], Figure], path: Path) -> None:
    """Draw and save, or save a note of the failure. Errors: `save_figure`.

    Parameters
    ----------
    draw : Callable[[], Figure]
        Makes the figure.
    path : Path
        Of the PNG file.
    """
    write_bytes(path, drawn_png(draw, path.stem))


def drawn_png(draw: Callable[[], Figure], name: str) -> bytes:
    """The figure as the content of a PNG file, or a note with its name where it cannot be drawn.

    Parameters
    ----------
    draw : Callable[[], Figure]
        Makes the figure.
    name : str
        What the note says could not be drawn.

    Returns
    -------
    bytes
        Content of the file.
    """
    figure = drawn(draw, name)
    try:
        with np.errstate(all="ignore"):
            return picture_bytes(figure, "png", dpi=_DPI)
    except NUMERICAL_ERRORS as error:
        return picture_bytes(_undrawable_figure(name, error), "png", dpi=_DPI)


def drawn(draw: Callable[[], Figure], name: str) -> Figure:
    """The figure, or a note with its name where its numbers cannot be drawn.

    Parameters
    ----------
    draw : Callable[[], Figure]
        Makes the figure.
    name : str
        What the note says could not be drawn.

    Returns
    -------
    Figure
        The figure or the note.
    """
    try:
        with ONE_DRAWS, np.errstate(all="ignore"):
            return draw()
    except (*NUMERICAL_ERRORS, InputError) as error:  # an estimated body need not be one that a model takes
        return _undrawable_figure(name, error)


def _undrawable_figure(name: str, error: Exception) -> Figure:
    return note_figure(f"{name} cannot be drawn: {reason(error)}")


def note_figure(text: str) -> Figure:
    """A sentence in the place of a picture that cannot be drawn.

    Parameters
    ----------
    text : str
        The sentence.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(10.0, 3.0), layout="constrained")
    figure.text(0.5, 0.5, text, ha="center", va="center", wrap=True, color=BLACK, parse_math=False)
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Write the figure as PNG, complete or not at all.

    Parameters
    ----------
    figure : Figure
        To be saved.
    path : Path
        Of the PNG file.

    Raises
    ------
    InputError
        As `spinfilters.io.output_files.write_bytes`.
    """
    write_bytes(path, picture_bytes(figure, "png", dpi=_DPI))


def picture_bytes(figure: Figure, form: str, **options: Any) -> bytes:
    """The figure as "png", "svg" or "pdf", drawn while no other thread draws; ``options`` are those of `Figure.savefig`.

    Parameters
    ----------
    figure : Figure
        To be saved.
    form : str
        "png", "svg" or "pdf".
    options : Any
        Of `Figure.savefig`.

    Returns
    -------
    bytes
        Content of the file.
    """
    target = BytesIO()
    with ONE_DRAWS, rc_context(LETTERS), _with_kept_ticks(figure):
        if form == "png" and options.keys() <= {"dpi"}:
            _draw_png(figure, target, **options)
        else:
            figure.savefig(target, format=form, **options)
    return target.getvalue()


def _draw_png(figure: Figure, target: BytesIO, dpi: float | None = None) -> None:
    """Lay out and draw once: `Figure.savefig` draws a figure with a layout twice, first without pixels."""
    own = figure.dpi
    try:
        figure.dpi = own if dpi is None else dpi
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        target.write(png_bytes(np.asarray(canvas.buffer_rgba()), figure.dpi, {"Software": _DRAWN_BY}))
    finally:
        figure.dpi = own


@contextmanager
def _with_kept_ticks(figure: Figure) -> Iterator[None]:
    """Make the ticks of an axis anew only where its limits or its panel's place change, not a dozen times in a picture."""
    axes_of = [
        axis for axes in figure.axes if axes.name == "rectilinear" for axis in (axes.xaxis, axes.yaxis)
    ]
    for axis in axes_of:
        _keep_ticks(axis)
    try:
        yield
    finally:
        for axis in axes_of:
            for method in (_MAKE_TICKS, _MEASURE_LABELS):
                vars(axis).pop(method, None)


def _keep_ticks(axis: Axis) -> None:
    """Let an axis keep its ticks, and the boxes of their labels, while its limits and its panel's place stay."""
    update, measure = getattr(axis, _MAKE_TICKS, None), getattr(axis, _MEASURE_LABELS, None)
    if update is None or measure is None:  # another matplotlib: it draws all the same
        return
    ticks, boxes = dict[tuple[float, ...], Any](), dict[int, Any]()

    def kept() -> Any:
        key = (*axis.get_view_interval(), *axis.axes.bbox.bounds)
        if key not in ticks:
            ticks.clear()  # ticks are objects of the axis, which the next ones move
            boxes.clear()
            ticks[key] = update()
        return ticks[key]

    def measured(given: Any, renderer: Any) -> Any:
        if not any(given is each for each in ticks.values()):
            return measure(given, renderer)
        if id(renderer) not in boxes:
            boxes[id(renderer)] = measure(given, renderer)
        return boxes[id(renderer)]

    vars(axis)[_MAKE_TICKS], vars(axis)[_MEASURE_LABELS] = kept, measured


def _legend_width(widths: Sequence[float], rows: int) -> float:
    """Inches of a legend filled column by column, each as wide as its widest entry."""
    return sum(max(widths[start : start + rows]) for start in range(0, len(widths), rows))
