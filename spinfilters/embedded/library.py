"""Texts of a generated library, and its compiled form for this machine."""

import ctypes
import re
from functools import cache
from importlib.resources import files

from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.generated_text import config_text, model_texts
from spinfilters.symbolic.c_library import FLAGS, load_text

HEADERS = (
    "spinfilter.h",
    *(f"spinfilter_{part}.h" for part in ("arithmetic", "matrix", "internal", "landmarks")),
)
PARTS = ("covariance", "reset", "predict", "update", "landmarks", "stereo")
SOURCES = tuple(f"spinfilter_{part}.c" for part in PARTS)
CONFIG, MODEL_HEADER, MODEL = "spinfilter_config.h", "spinfilter_model.h", "spinfilter_model.c"
INCLUDE = re.compile(r'^#include "(\w+\.h)".*$', re.MULTILINE)


@cache
def library_texts(options: EmbedOptions) -> dict[str, str]:
    """The C of a filter by file name."""
    texts = {name: template(name) for name in (*HEADERS, *SOURCES)}
    header, model = model_texts(options)
    return texts | {CONFIG: config_text(options), MODEL_HEADER: header, MODEL: model}


def template(name: str) -> str:
    """A file of the package ``c`` beside this module."""
    return files("spinfilters.embedded.c").joinpath(name).read_text()


@cache
def load_filter(options: EmbedOptions) -> ctypes.PyDLL | None:
    """The filter compiled for this machine with flight flags; None without a compiler."""
    return load_text("embedded_filter", one_text(library_texts(options)), (*FLAGS, "-fno-math-errno"))


def one_text(texts: dict[str, str]) -> str:
    """A library as one translation unit: every include of its own replaced by the file, once."""
    done: set[str] = set()

    def included(match: re.Match[str]) -> str:
        """An included file, the first time."""
        name = match.group(1)
        if name in done:
            return ""
        done.add(name)
        return INCLUDE.sub(included, texts[name])

    return "\n".join(INCLUDE.sub(included, texts[name]) for name in (MODEL, *SOURCES))
