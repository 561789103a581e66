"""Figures as a paper prints them: vector formats, the width of a column, one panel a file.

A panel is a set of axes with its colour bar, cut out of the figure. To bring it to a width the whole figure is scaled while letters
keep their size, so that panels of different figures look alike on a page. A whole figure keeps its proportions, letters included.
"""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from typing import Final, Literal

from matplotlib.axes import Axes
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_pdf import Op, PdfFile, RendererPdf
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from spinfilters.core.errors import InputError
from spinfilters.plots.style import ONE_DRAWS, picture_bytes

FORMATS: Final = ("png", "svg", "pdf")
COLUMN_MM: Final = {"single": 84.0, "double": 174.0}
"""Widths of one and of two columns, mm: those of most journals of the field."""
INCH_MM: Final = 25.4
PASSES: Final = 3
"""Layouts of a scaled figure: letters do not scale, so that a panel comes near its width step by step."""
MARGIN_INCHES: Final = 0.03
POINTS: Final = 72.0
"""Of an inch, in vector files."""
DPI: Final = 300
"""Of surfaces within vector files, and of PNG files."""
_SIDE: Final = re.compile(r'\b(width|height)="([0-9.]+)pt"')
"""Sides that an SVG file states first of all."""


@dataclass(frozen=True)
class PrintStyle:
    """How figures are printed.

    Attributes
    ----------
    form : str
        One of `FORMATS`.
    width_mm : float or None
        Of a figure or panel; None for its own.
    panels : bool
        One panel a file.

    Raises
    ------
    InputError
        Another format, or a width that is not positive.
    """

    form: Literal["png", "svg", "pdf"] = "pdf"
    width_mm: float | None = None
    panels: bool = False

    def __post_init__(self) -> None:
        if self.form not in FORMATS:
            raise InputError(f"format {self.form!r} is unknown; choose from {', '.join(FORMATS)}")
        if self.width_mm is not None and not (math.isfinite(self.width_mm) and self.width_mm > 0):
            raise InputError(f"width is {self.width_mm} mm; it must be positive")


def printed_figure(figure: Figure, name: str, style: PrintStyle) -> dict[str, bytes]:
    """Files of a figure by name: one, or one a panel with one for a common legend.

    Parameters
    ----------
    figure : Figure
        It is scaled, and not to be used afterwards.
    name : str
        Of the file without suffix; panels are numbered from 1 after it.
    style : PrintStyle
        Format, width, panels.

    Returns
    -------
    dict of str to bytes
        Contents by the name of the file.
    """
    with ONE_DRAWS:
        if not style.panels:
            width = style.width_mm
            factor = 1.0 if width is None else width / INCH_MM / figure.get_figwidth()
            return {f"{name}.{style.form}": _scaled_picture(figure, style.form, factor)}
        return dict(_panel_files(figure, name, style))


def figure_panels(figure: Figure) -> list[Axes]:
    """Panels of a figure: its visible axes without colour bars, in the order of drawing."""
    bars = {id(bar) for axes in figure.axes for bar in _colour_bars(axes)}
    return [axes for axes in figure.axes if axes.get_visible() and id(axes) not in bars]


def _panel_files(figure: Figure, name: str, style: PrintStyle) -> Iterator[tuple[str, bytes]]:
    panels = figure_panels(figure)
    figure.suptitle("")
    for axes in panels:
        _show_own_labels(axes)
    if style.width_mm is not None and panels:
        for _ in range(PASSES):
            figure.canvas.draw()
            factor = style.width_mm / INCH_MM / max(_box(figure, axes).width for axes in panels)
            figure.set_size_inches(*(factor * side for side in figure.get_size_inches()))
    figure.canvas.draw()
    figure.set_layout_engine(
        "none"
    )  # panels stay where they are: a layout anew for each would take most of the time
    for number, axes in enumerate(panels, start=1):
        box = _box(figure, axes)
        if style.width_mm is not None:  # letters keep their size: what is left over is margin
            missing = style.width_mm / INCH_MM - box.width
            box = Bbox.from_extents(box.x0 - missing / 2, box.y0, box.x1 + missing / 2, box.y1)
        hidden = [
            other for other in figure.axes if other not in (axes, *_colour_bars(axes)) and other.get_visible()
        ]
        for other in (*hidden, *figure.legends):
            other.set_visible(False)  # what lies outside of the box would be drawn in vain
        yield f"{name}-{number}.{style.form}", picture_bytes(figure, style.form, dpi=DPI, bbox_inches=box)
        for other in (*hidden, *figure.legends):
            other.set_visible(True)
    for axes in panels:
        axes.set_visible(False)
    if figure.legends:
        box = Bbox.union([_inches(figure, legend.get_window_extent()) for legend in figure.legends])
        box = box.padded(MARGIN_INCHES)
        yield f"{name}-legend.{style.form}", picture_bytes(figure, style.form, dpi=DPI, bbox_inches=box)


def _box(figure: Figure, axes: Axes) -> Bbox:
    """Box of a panel with its letters and colour bars, inches, in the present layout."""
    boxes = [each.get_tightbbox() for each in (axes, *_colour_bars(axes))]
    return Bbox.union([_inches(figure, box) for box in boxes if box is not None]).padded(MARGIN_INCHES)


def _inches(figure: Figure, box: Bbox) -> Bbox:
    return box.transformed(figure.dpi_scale_trans.inverted())


def _colour_bars(axes: Axes) -> list[Axes]:
    shown = (getattr(each, "colorbar", None) for each in (*axes.images, *axes.collections))
    return [bar.ax for bar in shown if bar is not None]


def _show_own_labels(axes: Axes) -> None:
    """Labels that a panel shares with others of its row or column become its own."""
    if not axes.axison or not hasattr(axes, "get_shared_x_axes"):
        return
    axes.tick_params(labelbottom=True, labelleft=True)
    for get, put, shared in (
        (Axes.get_xlabel, axes.set_xlabel, axes.get_shared_x_axes()),
        (Axes.get_ylabel, axes.set_ylabel, axes.get_shared_y_axes()),
    ):
        others = [get(other) for other in shared.get_siblings(axes) if get(other)]
        if not get(axes) and others:
            put(others[0])
    if not axes.get_ylabel():
        axes.set_ylabel(_label_of_row(axes))


def _label_of_row(axes: Axes) -> str:
    """Label of the y axis that the first labelled panel of a row has for all of them; empty without one."""
    own, figure = axes.get_subplotspec(), axes.get_figure()
    if own is None or figure is None:
        return ""
    for other in figure.axes:
        spec = other.get_subplotspec()
        same = spec is not None and spec.get_gridspec() is own.get_gridspec() and spec.rowspan == own.rowspan
        if same and other.get_ylabel():
            return other.get_ylabel()
    return ""


def _scaled_picture(figure: Figure, form: str, factor: float) -> bytes:
    """The figure as it is laid out in its own size, then scaled with letters, lines and every distance."""
    if factor == 1.0 or form == "png":
        return picture_bytes(figure, form, dpi=DPI * factor)
    if form == "pdf":
        return _scaled_pdf(figure, factor)
    content = picture_bytes(figure, form).decode()
    head, tag, rest = content.partition("<svg ")
    scaled = _SIDE.sub(lambda side: f'{side[1]}="{factor * float(side[2]):.6f}pt"', rest, count=2)
    return (head + tag + scaled).encode()  # the view box stays


def _scaled_pdf(figure: Figure, factor: float) -> bytes:
    """A page of the scaled size, whose coordinates are scaled before anything is drawn."""
    target, (width, height), own = BytesIO(), figure.get_size_inches(), figure.dpi
    with _pdf_file(target) as file:
        file.newPage(factor * width, factor * height)
        file.width, file.height = width, height  # curves are cut at these, before they are scaled
        file.output(factor, 0, 0, factor, 0, 0, Op.concat_matrix)
        renderer = MixedModeRenderer(figure, width, height, DPI, RendererPdf(file, DPI, height, width))
        try:
            figure.dpi = POINTS
            figure.draw(renderer)  # pyright: ignore[reportArgumentType]  (it has what a renderer has)
        finally:
            figure.dpi = own
        renderer.finalize()
    return target.getvalue()


@contextmanager
def _pdf_file(target: BytesIO) -> Iterator[PdfFile]:
    """A PDF that is complete where nothing fails."""
    file = PdfFile(target)
    try:
        yield file
        file.finalize()
    finally:
        file.close()
