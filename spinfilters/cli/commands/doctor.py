"""The command ``doctor``: what is installed and whether it works, the page to send with a bug report."""

import os
import platform
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from rich.console import Console
from rich.text import Text

import spinfilters
from spinfilters.cli.command import Command
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument
from spinfilters.run.provenance import PACKAGES, git_commit

if TYPE_CHECKING:
    from spinfilters.cli.installation_checks import InstallationCheck


NAME_WIDTH: Final[int] = 28
COMPILING_FAILED: Final[str] = (
    "compiling failed, or the cache folder is not yours alone; works without, but slower"
)
COMPILER_CURE: Final[str] = "works without, but slower; for speed: sudo apt-get install -y gcc libc6-dev"


@dataclass(frozen=True)
class DoctorArguments:
    """Arguments of ``doctor``."""

    compilers: Annotated[
        bool, Argument("also compare the C compilers of this machine: a minute for each of them")
    ] = False


def run_doctor(options: DoctorArguments) -> int:
    """Examine this installation, print what was found."""
    console = Console()
    code = doctor(console)
    if options.compilers:
        print_compilers(console)
    return code


def print_compilers(console: Console) -> None:
    """Processor times of one small comparison with each compiler's code, and whether the estimates agree."""
    from spinfilters.cli.compiler_comparison import agree, compare_compilers

    title = "\nA comparison of MEKF and smoother, 20 epochs of stereo tracks; processor time, s:"
    console.print(title, soft_wrap=True)
    found, usable = compare_compilers(), None
    while True:
        with console.status("compiling and running"):
            each = next(found, None)
        if each is None:
            return
        name = each.command or each.version
        if each.failure:
            _outcome(console, "FAILED", name, each.failure)
            continue
        usable = usable or each
        same = "estimates agree" if agree(each, usable) else "estimates DIFFER from the first"
        times = f"first {each.first:.1f}{', with compiling' if each.command else ''}; later {each.warm:.2f}; {same}"
        _outcome(console, "ok" if agree(each, usable) else "FAILED", name, times)
        if each.command:
            _outcome(console, "", "", each.version)


def doctor(console: Console | None = None, checks: "Iterable[InstallationCheck] | None" = None) -> int:
    """Print versions, compiler, cache and self-checks.

    Writes nothing outside the cache folder, and works without one.

    Returns
    -------
    int
        The exit code: 0 when every check passed, else 1.
    """
    console = console or Console()
    for name, text in _versions().items():
        _row(console, name, text)
    try:
        # only now: a library that cannot be loaded is a finding, not the end of the page
        from spinfilters.cli import installation_checks
    except InputError as error:  # of an environment variable: nothing is wrong with the installation
        cause, _, cure = str(error).partition("; ")
        _outcome(console, "FAILED", "environment", cause)
        _outcome(console, "cure", "", cure)
        return 1
    except Exception as error:
        _outcome(console, "FAILED", "imports", _reason(error))
        _outcome(console, "cure", "", "install again: make clean, then make compare")
        return 1
    _row(console, "C compiler", _compiler())
    _row(console, "compiled libraries", _libraries())
    with console.status("compiling; the first time this takes some seconds"):
        _row(console, "compiled code", _compiled_code())
    _row(console, "cache folder", _cache())
    _row(console, "BLAS threads", _threads())
    _row(console, "noise scaling", _scaling())
    console.print()
    passed = [_passes(console, check) for check in (installation_checks.CHECKS if checks is None else checks)]
    return 0 if all(passed) else 1


def _versions() -> dict[str, str]:
    return {
        "spinfilters": spinfilters.__version__,
        "folder": str(Path(spinfilters.__file__).parent),
        "git commit": git_commit() or "not a checkout",
        "Python": platform.python_version(),
        "platform": platform.platform(),
        **{name: _installed_version(name) for name in PACKAGES},
    }


def _installed_version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _compiler() -> str:
    from spinfilters.core.c_library import compiler, compiler_version

    path = compiler()
    if path is None:
        return f"none (or SPINFILTERS_COMPILE=off): {COMPILER_CURE}"
    try:
        return f"{path}, {compiler_version(path)}"
    except (OSError, subprocess.SubprocessError) as error:
        return f"{path} does not run ({_reason(error)}): {COMPILER_CURE}"


def _libraries() -> str:
    """Whether libraries came with the package, and for which instructions those are that this machine takes."""
    from spinfilters.core.c_library import interprets_all
    from spinfilters.core.shipped_libraries import LEVELS, levels, library_counts

    counts = library_counts()
    if not counts:
        return "none came with this installation: C is compiled here, once"
    came = ", ".join(f"{counts[name]} for {name}" for name in LEVELS if name in counts)
    mine = levels()
    if interprets_all() or not mine:
        return f"{came}: not used{' (SPINFILTERS_COMPILE=off)' if mine else ', this machine has other instructions'}"
    return f"{came}: those for {mine[0]} are used; C that none is built for is compiled here"


def _compiled_code() -> str:
    from spinfilters.cli.installation_checks import compare_with_virtual_machine
    from spinfilters.core.c_library import compiler

    try:
        found = compare_with_virtual_machine()
    except Exception as error:
        return f"could not be compared with the virtual machine ({_reason(error)})"
    if not found.is_c:
        return "not used" if compiler() is None else f"not used: {COMPILING_FAILED}"
    equal = "equal to" if found.equal else "NOT EQUAL to"
    return f"{equal} the virtual machine, {found.speedup:.1f} times as fast on a small function"


def _cache() -> str:
    from spinfilters.core.user_cache import cache_folder

    folder = cache_folder()
    if folder is None:
        return "none: this user has no home folder"
    try:
        sizes = [path.lstat().st_size for path in folder.glob("*.so")]
    except OSError as error:
        return f"{folder}, unreadable ({_reason(error)})"
    return f"{folder}, {sum(sizes) / 1e6:.1f} MB in compiled functions: {len(sizes)}"


def _threads() -> str:
    count = os.environ.get("OMP_NUM_THREADS")
    return count or "every core; on a busy machine small matrices are faster with OMP_NUM_THREADS=1"


def _scaling() -> str:
    """Scaling for the bundled example's time step and rate."""
    import numpy as np

    from observability.conditioning import suggest_scaling
    from spinfilters.core.conventions import RPM
    from spinfilters.simulation.scenario import THESIS_RPM

    try:
        return str(suggest_scaling(0.5, RPM * np.array(THESIS_RPM)))
    except Exception as error:
        return f"could not be computed ({_reason(error)})"


def _passes(console: Console, check: "InstallationCheck") -> bool:
    try:
        with console.status(check.name):
            measured = check.measure()
    except Exception as error:
        _outcome(console, "FAILED", check.name, _reason(error))
        _outcome(console, "cure", "", check.cure)
        return False
    _outcome(console, "ok", check.name, measured)
    return True


def _outcome(console: Console, word: str, name: str, text: str) -> None:
    style = {"ok": "green", "FAILED": "bold red"}.get(word, "")
    line = Text.assemble((f"{word:<8}", style), f"{name:<{NAME_WIDTH}}", _printable(text))
    console.print(line, soft_wrap=True)


def _row(console: Console, name: str, text: str) -> None:
    console.print(Text(f"{name:<{NAME_WIDTH}}{_printable(text)}"), soft_wrap=True)


def _printable(text: str) -> str:
    """Bytes of file names that are no text are escaped."""
    return text.encode("utf-8", "backslashreplace").decode()


def _reason(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


COMMAND = Command("doctor", DoctorArguments, run_doctor)
