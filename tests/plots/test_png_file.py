"""Pictures written as PNG hold exactly the pixels that were drawn, as another program reads them."""

from io import BytesIO

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from spinfilters.plots.png_file import png_bytes
from spinfilters.plots.style import LETTERS, picture_bytes


@pytest.mark.parametrize(("alpha", "mode"), [(255, "RGB"), (254, "RGBA")])
def test_another_program_reads_the_pixels_and_what_is_stated_of_them(alpha: int, mode: str) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (7, 11, 4), np.uint8)
    pixels[..., 3], pixels[0, 0, 3] = 255, alpha
    read = Image.open(BytesIO(png_bytes(pixels, 150, {"Software": "spinfilters"})))
    assert read.mode == mode
    assert np.array_equal(np.asarray(read.convert("RGBA")), pixels)
    assert read.info["dpi"] == pytest.approx((150, 150), rel=1e-3)
    assert read.info["Software"] == "spinfilters"


def figure() -> Figure:
    made = Figure(figsize=(3, 2), layout="constrained")
    made.subplots().plot([0.0, 1.0], [1.0, 0.0], alpha=0.4)
    return made


def test_a_figure_looks_as_matplotlib_saves_it() -> None:
    read = Image.open(BytesIO(picture_bytes(figure(), "png", dpi=80)))
    other, theirs = figure(), BytesIO()
    other.dpi = 80
    with rc_context(LETTERS):
        FigureCanvasAgg(other).print_png(theirs)
    assert np.array_equal(np.asarray(read.convert("RGBA")), np.asarray(Image.open(theirs).convert("RGBA")))
