"""What all tests share: checked shapes, figures without a screen, Ctrl-C, and the recordings of `../shared/data`."""

import gc
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path

import matplotlib as mpl
import pytest
from hypothesis import HealthCheck, settings
from pictures import unrendered_pictures
from shape_checks import check_shapes_of

check_shapes_of("spinfilters")
check_shapes_of("observability")
mpl.use("Agg")
# tests change what draws in their own process; those of further ones say so
os.environ.setdefault("SPINFILTERS_PICTURE_PROCESSES", "0")
# a busy machine is no failure
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

TESTS = Path(__file__).parent
SHARED_DATA = TESTS.parents[1] / "shared" / "data"
OF_RUNS = (
    *("attitudes_and_one_camera", "checkpoint", "distorted_lenses", "drag_law", "estimator_table"),
    *("finished_run", "foreign_checkpoint", "gyro_bias", "interrupts", "moving_inspector"),
    *("picture_process", "run_folder", "unstated_noise"),
)
OF_VERDICTS = (
    *("camera_refit", "correlated_errors", "estimate_diagnostics", "flywheel_refit", "front_end_slips"),
    *("hinge_refit", "inspector_alternatives", "jumps", "map_errors", "named_model_errors"),
    *("noise_diagnostics", "slow_changes"),
)
FEW_SAMPLES = {
    *("api", "campaigns", "cli", "docs", "hostile", "io", "live", "plots"),
    *("evaluation/test_reference.py", "evaluation/test_row_covariances.py"),
    *(f"run/test_{name}.py" for name in OF_RUNS),
    *(f"verdict/test_{name}.py" for name in OF_VERDICTS),
}
"""Rooms and files whose tests judge no sampled mass distribution."""
SHORT_ANIMATIONS = {"api", "cli", "docs", "live"}
"""Rooms that ask whether an animation is there; what its frames show is asked where figures are."""
OF_PROCESSES = {"campaigns/test_dask_cluster.py"}
"""Files that compare numbers with those of other processes, which sample in full."""
WORKER = os.environ.get("PYTEST_XDIST_WORKER", "")
COLLECTS_BACKWARDS = bool(WORKER) and int(WORKER.removeprefix("gw")) % 2 == 1


def pytest_configure(config: pytest.Config) -> None:
    """Further processes share the byte code of modules, also where it is not written beside them."""
    if sys.dont_write_bytecode and "PYTHONPYCACHEPREFIX" not in os.environ:
        folder = tempfile.TemporaryDirectory(prefix="spinfilters-bytecode-")
        config.add_cleanup(folder.cleanup)
        os.environ["PYTHONPYCACHEPREFIX"] = folder.name
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    """Every other worker collects from the last file to the first: each compiles half of them, and reads the others' byte code."""
    report = yield
    if COLLECTS_BACKWARDS and isinstance(collector, pytest.Session | pytest.Directory):
        report.result.reverse()
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All workers agree on the order, whatever they collected first."""
    if WORKER:
        items.sort(key=lambda item: item.path.parts)


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: the garbage collector need not walk through them again and again."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Few samples of a mass distribution where a test is about files, words or pictures: all take most of a short run's time."""
    file = item.path.relative_to(TESTS)
    few = FEW_SAMPLES & {file.parts[0], file.as_posix()} and file.as_posix() not in OF_PROCESSES
    short = file.parts[0] in SHORT_ANIMATIONS
    with few_samples() if few else nullcontext(), short_animations() if short else nullcontext():
        return (yield)


@contextmanager
def few_samples() -> Iterator[None]:
    """Sample the mass distribution and whole posteriors in the same way, with a ridge of few nodes and few samples."""
    from spinfilters.smoother import mass_posterior, posterior

    fewest = posterior.SamplingOptions(samples=24, walkers=12, steps=2, settling=0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(posterior, "sample_posterior", partial(posterior.sample_posterior, options=fewest))
        for name, number in (("SAMPLES", 16), ("TRIED", 8), ("MOST_NODES", 1)):
            patch.setattr(mass_posterior, name, number)
        yield


@contextmanager
def short_animations() -> Iterator[None]:
    """Draw three solves of an animation, the first and the last among them."""
    from spinfilters.plots import settling

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(settling, "MOST_FRAMES", 3)
        yield


@pytest.fixture(scope="session", autouse=True)
def ctrl_c_interrupts() -> None:
    """Where tests are started in the background the shell has Ctrl-C ignored, and tests of it could not pass."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def unrendered() -> Iterator[None]:
    """Pictures are composed and not rendered."""
    with unrendered_pictures():
        yield


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Path of a recording, ``shared_data("disam115")``; the test is skipped where it is absent."""

    def find(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.exists():
            pytest.skip(f"no recording at {path}")
        return path

    return find
