"""Compiled libraries that come with a wheel, so that neither a compiler nor a first compilation is needed.

They are built from the very texts that would be compiled here, for several instruction sets, and found by the digest of a text
(``.ci/libraries.py`` builds them). A text that none was built for is compiled, or its function interpreted, as without them.
"""

import hashlib
import os
import platform
from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).with_name("libraries")
SUFFIX: Final = ".so"
LEVELS: Final = {
    "x86-64-v4": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "x86-64-v3": {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"},
    "x86-64": {"sse2"},
    "armv8-a": {"asimd"},
}
"""Instruction sets as GCC names them, best first, and what /proc/cpuinfo must list for a machine to have each with those below."""
NATIVE: Final = "-march=native"
"""Flag that asks for every instruction of this machine."""


def shipped_name(text: str, flags: Sequence[str], level: str) -> str:
    """File name of the library of a C text that is compiled with these flags, `NATIVE` standing for the level."""
    key = "\0".join((text, *flags)).encode()
    return f"{hashlib.sha256(key).hexdigest()[:24]}-{level if NATIVE in flags else family(level)}{SUFFIX}"


def shipped_library(text: str, flags: Sequence[str]) -> Path | None:
    """The best library of this machine for a text that came with the package, or None."""
    if not has_libraries():
        return None
    names = (shipped_name(text, flags, level) for level in levels())
    return next((FOLDER / name for name in names if name in _files()), None)


def has_libraries() -> bool:
    """Whether libraries came with this installation that this machine may use (not with ``SPINFILTERS_COMPILE=here``)."""
    return not compiles_here() and platform.system() == "Linux" and bool(levels()) and bool(_files())


def compiles_here() -> bool:
    """Whether all that can be is to be compiled on this machine, and before it is used, ``SPINFILTERS_COMPILE=here``."""
    return os.environ.get("SPINFILTERS_COMPILE", "").lower() == "here"


def library_counts() -> dict[str, int]:
    """Number of libraries that came with this installation for each instruction set."""
    return dict(Counter(name.partition("-")[2].removesuffix(SUFFIX) for name in _files()))


@cache
def levels() -> tuple[str, ...]:
    """Instruction sets that this machine has, best first."""
    own = family(platform.machine())
    return tuple(name for name, needed in LEVELS.items() if family(name) == own and needed <= _instructions())


@cache
def processor() -> str:
    """Instructions of this processor as the system lists them, or its name."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())


def _instructions() -> set[str]:
    return set(processor().split())


def family(machine: str) -> str:
    """Architecture of a machine or an instruction set: that of its least one."""
    return (
        "x86-64" if machine.startswith("x86") else "armv8-a" if machine in {"aarch64", "armv8-a"} else machine
    )


@cache
def _files() -> frozenset[str]:
    try:
        return frozenset(name for name in os.listdir(FOLDER) if name.endswith(SUFFIX))
    except OSError:  # a checkout, or a wheel without
        return frozenset()
