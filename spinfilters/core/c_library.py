"""C code compiled to shared libraries, and the folder that keeps them between runs."""

import ctypes
import errno
import hashlib
import logging
import os
import platform
import shutil
import stat
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import casadi as ca

from spinfilters.core.errors import InputError
from spinfilters.core.shipped_libraries import (
    NATIVE,
    compiles_here,
    has_libraries,
    processor,
    shipped_library,
)
from spinfilters.core.user_cache import cache_folder
from spinfilters.core.working_time import building

OWN_FOLDER, OWN_FILE = 0o700, 0o600
"""Permissions given to what is made here, whatever the umask."""
OTHERS_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH
LARGEST_LIBRARY: Final = 1 << 26
"""Bytes, a hundred times the largest that is built here: a larger file is not read into memory."""
UNFINISHED: Final = "building-"
"""How folders and locks of builds in progress begin."""
LONGEST_BUILD: Final = 120.0
"""Time that a compiler is given, s."""
WAIT_FOR_BUILD: Final = 0.02
"""Time between two looks at a library that another process builds, s."""
ABANDONED: Final = 3600.0
"""Age from which a build in progress has been killed, s: none is allowed more than a few minutes."""


def private_folder() -> Path:
    """The cache folder, made if need be, links above it followed.

    Raises
    ------
    OSError
        There is none, it cannot be made, or others could write into it or put another in its place; the text says
        which.
    """
    wanted = cache_folder()
    if wanted is None:
        raise FileNotFoundError("this user has no home folder")
    folder = Path(os.path.realpath(wanted.parent)) / wanted.name
    _require_private(folder)
    for place in (*reversed(folder.parents), folder):
        if not place.exists():
            _make(place)
    _require_private(folder)
    return folder


def _make(folder: Path) -> None:
    try:
        folder.mkdir(mode=OWN_FOLDER)
    except FileExistsError:  # another process was quicker
        return
    folder.chmod(OWN_FOLDER)


def is_own_library(path: Path) -> bool:
    """Whether a file is regular, of one name, and writable by the user only."""
    found = path.lstat()
    return (
        stat.S_ISREG(found.st_mode)
        and found.st_uid == os.geteuid()
        and not found.st_mode & OTHERS_WRITE
        and found.st_nlink == 1
        and found.st_size <= LARGEST_LIBRARY
    )


def remove_abandoned_builds(folder: Path) -> None:
    """Delete what builds left behind that were killed."""
    for left in folder.glob(f"{UNFINISHED}*"):
        try:
            if time.time() - left.lstat().st_mtime <= ABANDONED:
                continue
        except FileNotFoundError:  # another process was quicker
            continue
        if left.suffix == ".lock":
            left.unlink(missing_ok=True)
        else:
            shutil.rmtree(left, ignore_errors=True)


def _require_private(folder: Path) -> None:
    """Check the parts of the path that are there."""
    if os.name != "posix":
        raise PermissionError("who may write into a folder is not known on this system")
    for place in (folder, *folder.parents):
        try:
            found = place.lstat()
        except FileNotFoundError:
            continue
        why = _shared_folder(found) if place == folder else _exchangeable(found)
        if why is not None:
            raise PermissionError(f"{place} {why}")


def _shared_folder(found: os.stat_result) -> str | None:
    """Why others could have written into the cache folder, or None."""
    if not stat.S_ISDIR(found.st_mode):
        return "is a link" if stat.S_ISLNK(found.st_mode) else "is no folder"
    if found.st_uid != os.geteuid():
        return "belongs to another user"
    return "can be written by others" if found.st_mode & OTHERS_WRITE else None


def _exchangeable(found: os.stat_result) -> str | None:
    """Why others could rename what lies in a folder above the cache folder, or None."""
    if not stat.S_ISDIR(found.st_mode):
        return "is no folder"
    if found.st_uid not in {0, os.geteuid()}:
        return "belongs to another user"
    if found.st_mode & stat.S_ISVTX or not found.st_mode & OTHERS_WRITE:
        return None
    if found.st_mode & stat.S_IWOTH or not _has_one_member(found.st_gid):
        return "can be written by others"
    return None


def _has_one_member(group: int) -> bool:
    """Whether a group is the user's private one.

    Systems with such groups usually have a umask of 002, and with it folders that the group may write to.
    """
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return user.pw_gid == group and found.gr_name == user.pw_name and set(found.gr_mem) <= {user.pw_name}


FLAGS = ("-O2", "-ffp-contract=off", "-shared", "-fPIC")
"""No contraction into fused multiply-adds, so that compiled code rounds as CasADi's virtual machine does."""
LONG_FLAGS = ("-O1", *FLAGS[1:])
"""Of long generated code, steps and their derivatives: as fast as with -O2, to the same bits, and compiled in 60 % of the time."""
LONG_TEXT: Final = 100_000
"""Characters from which generated code is long."""
KERNEL_FLAGS = (*(flag for flag in FLAGS if "contract" not in flag), "-O3", NATIVE, "-fno-math-errno")
"""Of loops that are linear algebra and have a NumPy reference: sums may be contracted."""

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


COMPILE_MODES: Final = {
    "on": "on",
    "1": "on",
    "yes": "on",
    "off": "off",
    "0": "off",
    "no": "off",
    "here": "here",
}
"""What ``SPINFILTERS_COMPILE`` may be, in small or capital letters, and what each means."""


def compile_mode() -> str:
    """Compile what did not come with the package, "on"; nothing, "off"; or all, "here": by ``$SPINFILTERS_COMPILE``.

    Raises
    ------
    InputError
        The environment variable is none of `COMPILE_MODES`.
    """
    stated = os.environ.get("SPINFILTERS_COMPILE") or "on"
    if stated.lower() not in COMPILE_MODES:
        raise InputError(
            f"environment variable SPINFILTERS_COMPILE is {stated[:40]!r}; give on, off or here, or unset it"
        )
    return COMPILE_MODES[stated.lower()]


compile_mode()  # a slip is told before anything is computed


def interprets_all() -> bool:
    """Whether no compiled code is wanted, ``SPINFILTERS_COMPILE=off``."""
    return compile_mode() == "off"


COMPILERS: Final = ("cc", "gcc", "clang")
"""Commands that are looked for, after that of ``$CC``."""


def compiler_version(command: str) -> str:
    """First line that a compiler prints of itself; OSError or SubprocessError where it does not run."""
    done = subprocess.run(
        [command, "--version"], capture_output=True, text=True, errors="replace", timeout=10, check=True
    )
    return done.stdout.partition("\n")[0]


@cache
def compiler() -> str | None:
    """Path of the C compiler (``$CC``, then `COMPILERS`), or None, as with ``SPINFILTERS_COMPILE=off``."""
    if interprets_all():
        return None
    for name in (os.environ.get("CC"), *COMPILERS):
        if name and (found := shutil.which(name)):
            return found
    return None


def load_loop(function: ca.Function) -> ctypes.PyDLL | None:
    """The function's loop over items as a shared library, or None (the caller then interprets)."""
    with building():
        return load_text(function.name(), *_text_and_flags(function)) if _may_load() else None


def kept_loop(function: ca.Function) -> ctypes.PyDLL | None:
    """The library of `load_loop` where one is there already; None where a compiler would have to make it, and may do so later."""
    if compiles_here():
        return load_loop(function)
    with building():
        return kept_text(function.name(), *_text_and_flags(function)) if _may_load() else None


def _text_and_flags(function: ca.Function) -> tuple[str, tuple[str, ...]]:
    text = _source(function)
    return text, FLAGS if len(text) < LONG_TEXT else LONG_FLAGS


def _may_load() -> bool:
    return compiler() is not None or (has_libraries() and not interprets_all())


def load_text(name: str, text: str, flags: tuple[str, ...]) -> ctypes.PyDLL | None:
    """C text as a shared library, or None: the one that came with the package, else compiled here.

    A file in the cache that is damaged, or that another user could have written, is not loaded but built again. There is no library
    without a working compiler, nor without a folder that is the user's alone.
    """
    if (shipped := _shipped(text, flags)) is not None:
        return shipped
    cc = compiler()
    if cc is None:
        return None
    try:
        with building():
            folder, stem = private_folder(), _stem(name, text, cc, flags)
            library = _undamaged(folder, stem) or _built((cc, *flags), text, folder / stem)
            return ctypes.PyDLL(str(library))
    except (OSError, subprocess.SubprocessError) as error:
        LOGGER.warning(
            "not compiled, which makes models several times slower: %s; see 'spinfilters doctor'",
            reason(error),
        )
        return None


def kept_text(name: str, text: str, flags: tuple[str, ...]) -> ctypes.PyDLL | None:
    """The library of `load_text` where it came with the package or an earlier run kept it, else None: no compiler runs."""
    if (shipped := _shipped(text, flags)) is not None:
        return shipped
    cc = compiler()
    if cc is None:
        return None
    try:
        with building():
            library = _undamaged(private_folder(), _stem(name, text, cc, flags))
            return None if library is None else ctypes.PyDLL(str(library))
    except OSError:  # `load_text` says why
        return None


def _stem(name: str, text: str, cc: str, flags: tuple[str, ...]) -> str:
    """How the file name of a library begins: its name, and a digest of all that it is made from and for."""
    machine = (platform.system(), platform.machine(), processor() if NATIVE in flags else "")
    key = "\0".join((text, cc, " ".join(flags), ca.CasadiMeta.version(), *machine))
    return f"{name}-{_digest(key.encode())}"


def _shipped(text: str, flags: tuple[str, ...]) -> ctypes.PyDLL | None:
    """The library that came with the package; None without one that this system can load, or where no compiled code is wanted."""
    if interprets_all():
        return None
    with building():
        library = shipped_library(text, flags)
        try:
            return None if library is None else ctypes.PyDLL(str(library))
        except OSError:  # of a newer C library, say
            return None


_TYPES = {"i": ctypes.c_longlong, "d": ctypes.c_double, "p": ctypes.c_void_p}


class Signature(NamedTuple):
    """Arguments of a function of a library, a letter each of `_TYPES`, and what it returns."""

    arguments: str
    result: type | None


def with_signatures(library: ctypes.PyDLL | None, signatures: Mapping[str, Signature]) -> ctypes.PyDLL | None:
    """The library, its functions given the types of their arguments and results for calls through ctypes."""
    if library is not None:
        for name, (arguments, result) in signatures.items():
            function = getattr(library, name)
            function.argtypes, function.restype = [_TYPES[letter] for letter in arguments], result
    return library


def reason(error: OSError | subprocess.SubprocessError) -> str:
    """Why there is no library, in a few words."""
    if isinstance(error, subprocess.CalledProcessError):
        full = os.strerror(errno.ENOSPC)
        if full.encode() in (error.stderr or b""):
            return f"{full}: the compiler needs some in {cache_folder()} and in {tempfile.gettempdir()}"
        return f"{error.cmd[0]} ends with exit code {error.returncode}"
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename or 'the cache folder'}: {error.strerror}"
    return str(error)


def has_wide_vectors() -> bool:
    """Whether this processor has vectors of 512 bits, as far as the system says."""
    return "avx512f" in processor().split()


def has_fused_products() -> bool:
    """Whether this processor multiplies and adds vectors of 256 bits in one instruction, as far as the system says."""
    return "fma" in processor().split() or platform.machine() not in {"x86_64", "AMD64"}


VECTOR_WIDTHS: Final = (4, 8)
"""Numbers of 64 bits in vectors of 256 and 512 bits, for which loops are written."""


def vector_width() -> int:
    """Number of lanes: that of ``$SPINFILTERS_LANES``, else of this machine.

    Raises
    ------
    InputError
        The environment variable is neither of the two widths.
    """
    stated = os.environ.get("SPINFILTERS_LANES", "")
    if not stated:
        return max(VECTOR_WIDTHS) if has_wide_vectors() else min(VECTOR_WIDTHS)
    if stated not in map(str, VECTOR_WIDTHS):
        raise InputError(
            f"environment variable SPINFILTERS_LANES is {stated[:40]!r}; give 4 or 8, or unset it"
        )
    return int(stated)


LANES: Final = vector_width()
"""Numbers side by side in loops written for vectors: one vector of this machine, or of the one that libraries are built for.

GCC takes a vector wider than the machine's apart, which costs 2 to 9 times the time."""


def no_library(function: ca.Function) -> None:
    """Loader of functions not worth compiling: no library."""


def _undamaged(folder: Path, stem: str) -> Path | None:
    """Cached library whose bytes have the digest in its name, or None."""
    for library in folder.glob(f"{stem}-*.so"):
        if is_own_library(library) and library.stem == f"{stem}-{_digest(library.read_bytes())}":
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


class _OneWarning(logging.Filter):
    """Lets the first warning pass: what keeps one function from being compiled keeps all."""

    given = False

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether to pass a record: no second warning."""
        first = not self.given or record.levelno < logging.WARNING
        self.given = self.given or record.levelno >= logging.WARNING
        return first


LOGGER = logging.getLogger("spinfilters.compile")
"""Says, at level INFO, that a library is being built: it takes seconds, and only the first time. Warns, once, if none can be."""
LOGGER.addFilter(_OneWarning())


def _built(command: tuple[str, ...], text: str, stem: Path) -> Path:
    """The library that another process is just making or, where none is, one that is made here."""
    with _alone(stem):
        return _undamaged(stem.parent, stem.name) or _compile(command, text, stem)


@contextmanager
def _alone(stem: Path) -> Iterator[None]:
    """Wait while another thread or process builds the library of this name.

    The system frees the lock of a process that ends, however it ends. Behind one that was halted, or in a folder without locks, a
    library is built twice, which costs time and does no harm: each is put in its place whole.
    """
    import fcntl  # the cache folder is one of a POSIX system

    path = stem.with_name(f"{UNFINISHED}{stem.name}.lock")
    lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, OWN_FILE)
    try:
        until = time.monotonic() + LONGEST_BUILD
        while time.monotonic() < until:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                time.sleep(WAIT_FOR_BUILD)
            except OSError:
                break
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(lock)


def _compile(command: tuple[str, ...], text: str, stem: Path) -> Path:
    """Build a library whose file name is the stem and its digest."""
    LOGGER.info("compiling %s", stem.name)
    remove_abandoned_builds(stem.parent)
    with tempfile.TemporaryDirectory(dir=stem.parent, prefix=UNFINISHED) as scratch:
        source, built = Path(scratch) / "source.c", Path(scratch) / "built.so"
        source.write_text(text)
        whole, found = (
            [*command, "-o", built, source, "-lm"],
            {"PATH": os.defpath, **os.environ, "LC_ALL": "C"},
        )
        subprocess.run(whole, check=True, capture_output=True, timeout=LONGEST_BUILD, env=found)
        built.chmod(OWN_FILE)
        library = stem.with_name(f"{stem.name}-{_digest(built.read_bytes())}.so")
        os.replace(built, library)
    return library
