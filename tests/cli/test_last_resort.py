"""What a command says of an error that nobody foresaw, and of names that are no text."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from spinfilters.cli.interrupts import AGAIN_S, INTERRUPTED, noted_interrupts
from spinfilters.cli.main import main
from spinfilters.simulation import scenario
from tests.cli.faults import refusal


class PressedInFinalizer:
    """What presses Ctrl-C where Python cannot raise: in a finalizer."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def fail(_: object) -> None:
    """An error that is no one's fault but the program's."""
    raise ValueError("shapes differ\nin two lines")


def test_an_unforeseen_error_is_one_line_that_names_its_place(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("SPINFILTERS_DEBUG", raising=False)
    monkeypatch.setattr(scenario, "simulate", fail)
    said = refusal(capsys, "compare")
    assert "unexpected ValueError in spinfilters/cli/commands/compare.py:" in said
    assert "_dataset" in said
    assert "SPINFILTERS_DEBUG=1" in said


def test_with_debugging_the_whole_trace_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPINFILTERS_DEBUG", "1")
    monkeypatch.setattr(scenario, "simulate", fail)
    with pytest.raises(ValueError, match="shapes differ"):
        main(["compare"])


def test_a_library_that_calls_ctrl_c_an_error_of_its_own_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], default_interrupts: None
) -> None:
    """As NumPy does, whose import ends in an ImportError."""

    def import_interrupted(_: object) -> None:
        """Press Ctrl-C, and lose it."""
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise ImportError("could not import module datetime")

    monkeypatch.setattr(scenario, "simulate", import_interrupted)
    assert "interrupted" in refusal(capsys, "compare")


def test_ctrl_c_while_the_arguments_are_read_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], default_interrupts: None
) -> None:
    monkeypatch.setattr("spinfilters.cli.main.parser", lambda: signal.raise_signal(signal.SIGINT))
    assert "interrupted" in refusal(capsys, "compare")


def test_a_swallowed_ctrl_c_is_told(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    default_interrupts: None,
) -> None:
    def swallowed(*_: object) -> float:
        """Press Ctrl-C, and lose it."""
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return 0.5

    monkeypatch.setattr("observability.conditioning.best_time_step", swallowed)
    assert main(["condition", "--time-step", "0.5", "-o", str(tmp_path / "c")]) == 0
    assert "nothing is missing" in capsys.readouterr().err


def test_a_swallowed_ctrl_c_ends_a_live_run_at_the_next_epoch(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    originals: Path,
    default_interrupts: None,
) -> None:
    epochs: list[object] = []

    def keep(_: object, answer: object) -> None:
        epochs.append(answer)
        PressedInFinalizer()

    monkeypatch.setattr("spinfilters.live.answer.CourseRecorder.keep", keep)
    assert main(["live", str(originals / "gyro"), "--speed", "1e6", "--no-smoother"]) in (0, 1)
    assert len(epochs) == 1
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert "KeyboardInterrupt" not in said


def test_a_ctrl_c_that_a_finalizer_loses_is_pressed_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], default_interrupts: None
) -> None:
    def lose_and_work(_: object) -> None:
        """Press Ctrl-C where Python cannot raise, then work for long."""
        PressedInFinalizer()
        time.sleep(5)
        pytest.fail("nobody pressed again")

    monkeypatch.setattr(scenario, "simulate", lose_and_work)
    assert "interrupted" in refusal(capsys, "compare")


PRESSED_WHILE_LOADING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)

class Presser:
    \"\"\"Presses Ctrl-C when a module is looked for.\"\"\"

    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[1]:
            {press}

sys.meta_path.insert(0, Presser())
from spinfilters.cli.entry_point import main
sys.exit(main())
"""
LOST = "try: signal.raise_signal(signal.SIGINT)\n            except KeyboardInterrupt: pass"


@pytest.mark.parametrize("press", ["signal.raise_signal(signal.SIGINT)", LOST], ids=["raised", "lost"])
@pytest.mark.parametrize("module", ["spinfilters.cli.main", "argparse", "spinfilters.io.stated_values"])
def test_a_ctrl_c_while_the_command_loads_ends_it_in_one_line(module: str, press: str) -> None:
    program = PRESSED_WHILE_LOADING.replace("{press}", press)
    found = subprocess.run([sys.executable, "-c", program, module], capture_output=True, text=True)
    assert found.returncode == 2
    assert found.stderr.splitlines() == [f"spinfilters: {INTERRUPTED}"]


def test_a_ctrl_c_within_a_call_of_casadi_waits_for_its_end(default_interrupts: None) -> None:
    """CasADi calls Python methods of arguments, as ``shape``, and drops what they raise."""
    casadi = {"__name__": "casadi.casadi", "suppress": suppress, "returned": False}
    exec(
        "def call(method):\n  global returned\n  with suppress(BaseException):\n    method()\n  returned = True",
        casadi,
    )
    with noted_interrupts() as pressed, suppress(KeyboardInterrupt):
        casadi["call"](lambda: signal.raise_signal(signal.SIGINT))  # pyright: ignore[reportCallIssue]
        time.sleep(5)
        pytest.fail("nobody pressed again")
    assert casadi["returned"]
    assert len(pressed) == 2


def test_a_lost_ctrl_c_does_no_harm_behind_the_command(default_interrupts: None) -> None:
    with noted_interrupts() as pressed:
        PressedInFinalizer()
    time.sleep(3 * AGAIN_S)
    assert pressed


def test_a_ctrl_c_within_a_string_of_code_leaves_the_exit_code(tmp_path: Path) -> None:
    """As that of a dataclass while a package loads: Python then ends the process as by a signal, although it was caught."""
    (tmp_path / "pressed.py").write_text(
        """
import signal
from contextlib import suppress
from spinfilters.cli.interrupts import noted_interrupts

signal.signal(signal.SIGINT, signal.default_int_handler)
with noted_interrupts(), suppress(KeyboardInterrupt):
    exec("signal.raise_signal(signal.SIGINT)")
raise SystemExit(2)
"""
    )
    ended = subprocess.run([sys.executable, "-m", "pressed"], cwd=tmp_path, check=False)
    assert ended.returncode == 2


def test_what_a_finalizer_fails_of_reaches_the_hook_that_was_there(
    monkeypatch: pytest.MonkeyPatch, default_interrupts: None
) -> None:
    """That of pytest, say, which makes it a failure."""
    told: list[str] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: told.append(lost.exc_type.__name__))

    class Fails:
        """What raises where Python cannot."""

        def __init__(self, error: type[BaseException]) -> None:
            self.error = error

        def __del__(self) -> None:
            raise self.error

    with noted_interrupts():
        Fails(KeyboardInterrupt)
        Fails(OverflowError)
    assert told == ["OverflowError"]


def test_a_broken_backend_of_pictures_does_no_harm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    drawn = ["threshold", "--mission", "orbital-express", "--rate-rpm", "0.2", "-o", str(tmp_path / "t")]
    command = [sys.executable, "-m", "spinfilters.cli.main", *drawn]
    subprocess.run(command, env=os.environ | {"MPLBACKEND": "nonsense"}, check=True, capture_output=True)
    assert list((tmp_path / "t").glob("*.png"))


@pytest.fixture
def default_interrupts() -> Iterator[None]:
    """Python's own answer to Ctrl-C, which tests in the background do not have."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_long_path_leaves_room_for_what_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refusal(capsys, "compare", str(tmp_path / ("a" * 200) / ("b" * 200)))
    assert len(said) < 300
    assert "check the path" in said


@pytest.mark.usefixtures("few_figures")
@pytest.mark.parametrize("name", [b"a\xffb.csv", b"[red]a[bold].csv", b"a\x1b[2Jb.csv"])
def test_a_recording_of_any_name_is_estimated(
    name: bytes, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, run = tmp_path / os.fsdecode(name), tmp_path / os.fsdecode(b"run \xff [bold]")
    shutil.copyfile(originals / "gyro" / "gyro.csv", recording)
    assert main(["compare", str(recording), "--estimators", "mekf", "-o", str(run)]) == 0
    assert (run / "summary.json").is_file()
    assert "[bold]" in capsys.readouterr().out


def test_a_path_of_usual_length_leaves_a_long_message_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"{'a' * (119 - len(str(tmp_path)) - 5)}.csv"
    path.write_text(
        "".join(["t [s],w_x [rad/s],w_y [rad/s],w_z [rad/s]\n", *(f"{0.1 * k},1,2,3\n" for k in range(60))])
    )
    said = refusal(capsys, "compare", str(path), "-o", str(tmp_path / "run"))
    assert said.startswith(
        f"spinfilters: {path}: the gyro's rates never change, so its noise cannot be distinguished from"
    )
    assert said.endswith("or another recording\n")
