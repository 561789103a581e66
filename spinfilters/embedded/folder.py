"""The folder of a generated filter.

C, Makefile, test vectors and a page for the firmware engineer.
"""

from pathlib import Path

from spinfilters.data.atomic_write import write_text
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.library import library_texts, template
from spinfilters.embedded.vectors import make_vectors

TEST = ("test_spinfilter.c", "test_spinfilter.h", "firmware.c", "firmware.ld", "Makefile")
BYTES = {"float": 4, "double": 8}


def folder_texts(options: EmbedOptions) -> dict[str, str]:
    """Texts of all files by name."""
    texts = library_texts(options) | {name: template(name) for name in TEST}
    texts["test_vectors.h"] = make_vectors(options).text()
    texts["README.md"] = readme_text(options)
    return texts


def write_library(options: EmbedOptions, folder: Path) -> list[Path]:
    """Write the folder, which exists; the files written."""
    texts = folder_texts(options)
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def readme_text(options: EmbedOptions) -> str:
    """``README.md``."""
    layout, size = options.layout, BYTES[options.real]
    n = layout.error_dim
    state = size * (layout.mean_dim + n * (n - 1) // 2 + n + 3) + 8
    rows = [f"| `sf_filter` | {state} bytes |"]
    if options.has_map:
        rows.append(f"| map of {options.landmarks} landmarks | {options.landmarks * (9 * size + 4)} bytes |")
    values = {
        "options": f"sensor {options.sensor}, {options.real}, {options.substeps} substeps",
        "sizes": "\n".join(rows),
        "state": ", ".join(f"`{block.symbol}` ({block.mean_size})" for block in layout.members),
        "turn": f"{0.08 * options.substeps:.2f}",
    }
    text = template("README.md")
    for name, value in values.items():
        text = text.replace(f"{{{name}}}", value)
    return text
