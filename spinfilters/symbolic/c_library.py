"""C text, of CasADi functions above all, compiled once and cached by a hash of everything that shapes it."""

import ctypes
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import casadi as ca
import platformdirs

FLAGS = ("-O2", "-ffp-contract=off", "-shared", "-fPIC")
"""No contraction into fused multiply-adds, so that compiled code rounds as CasADi's virtual machine does."""
NATIVE = "-march=native"
"""Every instruction of this machine: for code that handles many items side by side."""

_LOOP = """
#include <stdlib.h>
int spinfilters_loop(long long n, const double* const* base, const long long* stride,
                     double* const* out, const long long* out_stride) {{
  const casadi_real* arg[{sz_arg}]; casadi_real* res[{sz_res}]; casadi_int iw[{sz_iw}];
  casadi_real* w = (casadi_real*) malloc({sz_w} * sizeof(casadi_real));
  int flag = 0;
  if (w == 0) return 1;
  for (long long i = 0; i < n && flag == 0; ++i) {{
    for (int k = 0; k < {n_in}; ++k) arg[k] = base[k] + i * stride[k];
    for (int k = 0; k < {n_out}; ++k) res[k] = out[k] + i * out_stride[k];
    flag = {name}(arg, res, iw, w, 0);
  }}
  free(w);
  return flag;
}}
"""


@cache
def compiler() -> str | None:
    """Path of the C compiler (``$CC``, cc, gcc, clang), or None, as with ``SPINFILTERS_COMPILE=off``."""
    if os.environ.get("SPINFILTERS_COMPILE", "on").lower() in {"off", "0", "no"}:
        return None
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        if name and (found := shutil.which(name)):
            return found
    return None


def cache_folder() -> Path:
    """Where compiled libraries are kept: ``$SPINFILTERS_CACHE`` or the user's cache folder."""
    return Path(os.environ.get("SPINFILTERS_CACHE") or platformdirs.user_cache_dir("spinfilters"))


def load_loop(function: ca.Function) -> ctypes.PyDLL | None:
    """The function's loop over items as a shared library, or None (the caller then interprets)."""
    return load_text(function.name(), _source(function), FLAGS) if compiler() else None


def load_text(name: str, text: str, flags: tuple[str, ...]) -> ctypes.PyDLL | None:
    """C text as a shared library, or None.

    A damaged file in the cache is built again; without a working compiler there is no library.
    """
    cc = compiler()
    if cc is None:
        return None
    machine = (platform.system(), platform.machine(), processor() if NATIVE in flags else "")
    key = "\0".join((text, cc, " ".join(flags), ca.__version__, *machine))
    stem = f"{name}-{_digest(key.encode())}"
    try:
        library = _undamaged(stem) or _compile((cc, *flags), text, stem)
        return ctypes.PyDLL(str(library))
    except (OSError, subprocess.SubprocessError):
        return None


@cache
def processor() -> str:
    """What tells this machine's instructions from another's that shares the cache folder."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())


def interpret(function: ca.Function) -> None:
    """The loader for a function too small or too rarely called to be worth a compiler run: no library."""


def _undamaged(stem: str) -> Path | None:
    """The cached library whose bytes have the digest in its name: to map one cut short kills the process."""
    for library in cache_folder().glob(f"{stem}-*.so"):
        if library.stem == f"{stem}-{_digest(library.read_bytes())}":
            return library
    return None


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:24]


def _source(function: ca.Function) -> str:
    generator = ca.CodeGenerator(function.name(), {"with_header": False})
    generator.add(function)
    loop = _LOOP.format(
        name=function.name(),
        n_in=function.n_in(),
        n_out=function.n_out(),
        sz_arg=max(1, function.sz_arg()),
        sz_res=max(1, function.sz_res()),
        sz_iw=max(1, function.sz_iw()),
        sz_w=max(1, function.sz_w()),
    )
    return generator.dump() + loop


LOGGER = logging.getLogger("spinfilters.compile")
"""Says, at level INFO, that a library is being built: it takes seconds, and only the first time."""


def _compile(command: tuple[str, ...], text: str, stem: str) -> Path:
    LOGGER.info("compiling %s", stem)
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        source, built = Path(scratch) / "source.c", Path(scratch) / "built.so"
        source.write_text(text)
        subprocess.run([*command, "-o", built, source, "-lm"], check=True, capture_output=True, timeout=120)
        library = folder / f"{stem}-{_digest(built.read_bytes())}.so"
        os.replace(built, library)
    return library
