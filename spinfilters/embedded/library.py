"""C library of the embedded filter: the generated models and the fixed sources."""

import ctypes
import re
from functools import cache
from importlib.resources import files
from textwrap import fill, wrap

import casadi as ca
from scipy.special import chdtri

from spinfilters.core.c_library import FLAGS, load_text
from spinfilters.core.working_time import building
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.model_functions import model_functions, moving_dim, seen_columns, transition_pattern
from spinfilters.filters.landmark_map import CONFIRMED, WRONG_IN_A_ROW
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.models.rotation_integrator import boole_weights
from spinfilters.models.state_blocks import GYRO_BIAS

HEADERS = (
    "spinfilter.h",
    *(f"spinfilter_{part}.h" for part in ("arithmetic", "matrix", "internal", "landmarks", "moments")),
)
PARTS = ("covariance", "reset", "predict", "update", "landmarks", "stereo", "moments")
SOURCES = tuple(f"spinfilter_{part}.c" for part in PARTS)
CONFIG, MODEL_HEADER, MODEL = "spinfilter_config.h", "spinfilter_model.h", "spinfilter_model.c"
INCLUDE = re.compile(r'^#include "(\w+\.h)".*$', re.MULTILINE)


@cache
@building()
def library_texts(options: EmbedOptions) -> dict[str, str]:
    """The C of a filter by file name."""
    texts = {name: with_walk(template(name), options) for name in (*HEADERS, *SOURCES)}
    header, model = model_texts(options)
    return texts | {CONFIG: config_text(options), MODEL_HEADER: header, MODEL: model}


def template(name: str) -> str:
    """A file of the package ``c`` beside this module."""
    return files("spinfilters.embedded.c").joinpath(name).read_text()


BIAS_WALK = "SF_GYRO_BIAS_PSD"
WALK_PART = re.compile(rf"^#ifdef {BIAS_WALK}\n.*?^#endif\n\n?", re.MULTILINE | re.DOTALL)


def with_walk(text: str, options: EmbedOptions) -> str:
    """A file's text, without the parts of a bias that walks where it does not."""
    return text if options.gyro_bias_psd else WALK_PART.sub("", text)


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


NUMBER = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?)")
BODY = re.compile(r"static int casadi_f0\(.*?\{\n(.*?)  return 0;\n\}", re.DOTALL)
WIDTH = 115
SIMPSON = (1 / 3, 4 / 3, 1 / 3)
TURN_OF_SUBSTEP = 0.08
"""Rotation of a substep in rad, about, above which its error is worth a word: the fifth power over 120 is 3e-8 rad."""
RENAMED = {
    "casadi_real": "sf_real",
    "casadi_sq(": "sf_square(",
    "casadi_fmax(": "sf_max(",
    "casadi_fmin(": "sf_min(",
    "fabs(": "sf_abs(",
    "sqrt(": "SF_SQRT(",
    "exp(": "sf_exp(",
    "casadi_log1p(": "sf_log1p(",
}


def model_texts(options: EmbedOptions) -> tuple[str, str]:
    """``spinfilter_model.h`` and ``spinfilter_model.c``: one function per model function, in either precision."""
    functions = [function_text(each) for each in model_functions(options)]
    note = "/* Generated from the models of spinfilters; not to be edited. Matrices row by row. */\n"
    declarations = "".join(text.partition("\n{")[0] + ";\n" for text in functions)
    header = (
        f'{note}#ifndef SPINFILTER_MODEL_H\n#define SPINFILTER_MODEL_H\n\n#include "spinfilter.h"\n\n'
        f"{declarations}\n#endif\n"
    )
    include = '#include "spinfilter_model.h"\n\n#include "spinfilter_arithmetic.h"\n'
    return header, note + include + "".join("\n" + text for text in functions)


def function_text(function: ca.Function) -> str:
    """A function of scalar expressions as C.

    Inputs and outputs by name, no work arrays, numbers of the filter's precision.

    Raises
    ------
    ValueError
        a call that a filter without libm cannot make.
    """
    body = _body(function)
    inputs = [f"const sf_real *{name}" for name in function.name_in()]
    inputs = [
        text.replace("const sf_real *", "const sf_real ") + "_" if name in SCALARS else text
        for text, name in zip(inputs, function.name_in(), strict=True)
    ]
    scalars = [name for name in function.name_in() if name in SCALARS]
    given = "".join(
        f"  const sf_real {name}[1] = {{{name}_}};\n" if f"{name}[" in body else f"  (void){name}_;\n"
        for name in scalars
    )
    outputs = [f"sf_real *{name}" for name in function.name_out()]
    signature = fill(
        f"void sf_model_{function.name()}({', '.join(inputs + outputs)})", WIDTH, subsequent_indent="  "
    )
    return f"{signature}\n{{\n{given}{body}}}\n"


def _body(function: ca.Function) -> str:
    """Statements of the function in the embedded arithmetic. ValueError: as `function_text`."""
    generator = ca.CodeGenerator("model", {"with_header": False, "casadi_int": "int"})
    generator.add(function)
    found = BODY.search(generator.dump())
    assert found is not None
    body = found.group(1)
    for k in range(function.n_in()):
        body = re.sub(rf"arg\[{k}\]\? arg\[{k}\]\[(\d+)\] : 0", rf"{function.name_in(k)}[\1]", body)
    for k in range(function.n_out()):
        body = body.replace(f"if (res[{k}]!=0) res[{k}][", f"{function.name_out(k)}[")
    for old, new in RENAMED.items():
        body = re.sub(rf"(?<![\w]){re.escape(old)}", new, body)
    body = NUMBER.sub(r"SF_R(\1)", body)
    body = re.sub(r"=\((.*)\);", r"=\1;", body)
    calls = set(re.findall(r"[A-Za-z_]\w*(?=\()", body)) - {"SF_R", *(n[:-1] for n in RENAMED.values())}
    if calls or "arg[" in body or "res[" in body:
        raise ValueError(f"{function.name()} needs {calls}, which the embedded arithmetic does not have")
    return body


SCALARS = ("h", "dt")
"""Inputs that are handed over by value."""


def config_text(options: EmbedOptions) -> str:
    """``spinfilter_config.h``: sizes, places, gates and the sparsity of the transition."""
    layout = options.layout
    names = ", ".join(f"{block.symbol} {block.mean_size}" for block in layout.members)
    lines = [
        "/* Generated with spinfilter_model.h; not to be edited. */",
        "#ifndef SPINFILTER_CONFIG_H",
        "#define SPINFILTER_CONFIG_H",
        "",
        *(["#define SF_DOUBLE"] if options.real == "double" else []),
        *(f"#define SF_HAS_{name.upper()}" for name in options.sensors),
        f'#define SF_STATE "{names}" /* of x; errors: {", ".join(layout.blocks)}, one number less for q */',
        *(f"#define {name} {value}" for name, value in _config_numbers(options).items()),
        "",
        *_pattern_lines(options),
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def _config_numbers(options: EmbedOptions) -> dict[str, float | str]:
    """Sizes, places in the state, and gates, by their macros."""
    layout, count = options.layout, options.substeps
    phi, g = transition_pattern(layout)
    models = {each: each.model(layout) for each in options.emitted}
    seen = seen_columns(models[options.emitted[0]])
    numbers: dict[str, float | str] = {
        "SF_NX": layout.mean_dim,
        "SF_N": layout.error_dim,
        "SF_MOVING": moving_dim(layout),
        "SF_NOISE": 1 + max(max(row) for row in g),
        "SF_A": layout.slice("a").start,
        "SF_S": layout.slice("s").start,
        "SF_X_Q": layout.mean_slice("a").start,
        "SF_X_W": layout.mean_slice("w").start,
        "SF_X_S": layout.mean_slice("s").start,
        "SF_SEEN": seen[0],
        "SF_SEEN_COUNT": len(seen),
        "SF_PHI_COUNT": sum(map(len, phi)),
        "SF_G_COUNT": sum(map(len, g)),
        "SF_SUBSTEPS": count,
        "SF_LARGEST_TURN": round(TURN_OF_SUBSTEP * count, 6),
        "SF_GATE_3": _gate(3),
        "SF_GATE_6": _gate(6),
        "SF_CONFIRMED": CONFIRMED,
        "SF_WRONG_IN_A_ROW": WRONG_IN_A_ROW,
    }
    for each, model in models.items():
        numbers |= each.macros(model, options.landmarks)
    if options.gyro_bias_psd:
        numbers |= {"SF_B": layout.slice(GYRO_BIAS.name).start, BIAS_WALK: repr(options.gyro_bias_psd)}
    return numbers


def _pattern_lines(options: EmbedOptions) -> list[str]:
    """Sparsity of the transition and weights of the noise, as one macro."""
    phi, g = transition_pattern(options.layout)
    weights = ", ".join(f"(sf_real){w!r}" for w in noise_weights(options.substeps))
    return [
        "#define SF_PATTERN /* of the moving rows of transition and noise factor, for spinfilter_predict.c alone */ \\",
        *_table("unsigned char sf_phi_start", _starts(phi)),
        *_table("unsigned char sf_phi_column", [c for row in phi for c in row]),
        *_table("unsigned char sf_g_start", _starts(g)),
        *_table("unsigned char sf_g_column", [c for row in g for c in row]),
        *_table("unsigned char sf_row_end", _ends(g, moving_dim(options.layout))),
        f"  static const sf_real sf_weight[] = {{{weights}}}",
    ]


def noise_weights(substeps: int) -> list[float]:
    """Quadrature weights of the process noise in a prediction: Simpson's rule of two substeps, Boole's of more."""
    return list(SIMPSON) if substeps == 2 else [float(weight) for weight in boole_weights(substeps)]


def _gate(dof: int) -> float:
    return round(float(chdtri(dof, 1 - RobustOptions().gate_probability)), 6)


def _starts(rows: list[list[int]]) -> list[int]:
    starts = [0]
    for row in rows:
        starts.append(starts[-1] + len(row))
    return starts


def _ends(g: list[list[int]], moving: int) -> list[int]:
    """Columns that a row of [Phi U | G] fills, at most, once the rows below it have been eliminated."""
    ends = [moving + 1 + max(row) for row in g]
    assert moving % 3 == 0
    return [-(-max(ends[k:]) // 3) * 3 for k in range(len(ends))]


def _table(name: str, values: list[int]) -> list[str]:
    lines = wrap(f"static const {name}[] = {{{', '.join(map(str, values))}}};", WIDTH, subsequent_indent="  ")
    return [f"  {line} \\" for line in lines]
