"""Write the golden copy anew: ``python -m tests.embedded.golden``."""

from pathlib import Path

import casadi as ca

from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.library import library_texts

HERE = Path(__file__).parent

if __name__ == "__main__":
    texts = library_texts(EmbedOptions("pose"))
    for name in ("spinfilter_config.h", "spinfilter_model.h", "spinfilter_model.c"):
        (HERE / name).write_text(texts[name])
    (HERE / "casadi.txt").write_text(ca.CasadiMeta.version() + "\n")
