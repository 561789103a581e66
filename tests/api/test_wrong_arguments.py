"""Arguments of wrong types and values: InputError names the argument and its value, and nothing is run."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters import InputError
from spinfilters.api.analysis import KnownInputs

NO_PATH = (None, 3, 2.5, float("nan"), True, b"gyro.csv", "", "a\0b", [], ["gyro.csv"], {}, object())
NO_TEXT = (None, 3, float("nan"), b"gyro", "", " ", [], {}, object())
NO_TRUTH = (None, 1, "yes", float("nan"), [], np.array([True, False]))
NO_NUMBER = (None, "1", float("nan"), float("inf"), -1, True, [], [1], {}, 1j, object())
NO_THREE = (
    None,
    1.0,
    "1,2,3",
    b"abc",
    [],
    [1, 2],
    [1, 2, 3, 4],
    [1, 2, "x"],
    [1, 2, float("nan")],
    {1: 2},
    np.eye(3),
)
NO_NAMES = (
    3,
    float("nan"),
    b"mekf",
    "",
    ",",
    "mekf,,ukf",
    [],
    [3],
    ["mekf", None],
    {},
    np.array(["mekf"]),
    object(),
)
NO_FUNCTION = (None, 3, "print", [])
NO_MAPPING = (3, "gyro", [], [1], {"gyro": "x"}, {"gyro": float("nan")}, {3: 0.1})


def but_none(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Of an argument that may be left out."""
    return tuple(value for value in values if value is not None)


RECORDING = Path("no-such-recording.csv")
"""Would be complained of, were it looked for."""
WRONG: dict[str, tuple[Callable[..., object], dict[str, tuple[Any, ...]]]] = {
    "load": (
        lambda **given: spinfilters.load(**(dict[str, Any](path=RECORDING) | given)),
        {
            "path": NO_PATH,
            "segment": (2.5, float("nan"), b"1", [], {}, -1, True, object()),
            "unit": but_none(NO_TEXT),
            "clock": but_none(NO_TEXT),
            "rate": but_none(NO_NUMBER),
            "topic": but_none(NO_TEXT),
            "columns": but_none(NO_TEXT),
            "kind": but_none(NO_TEXT),
            "units": (3, 2.5, float("nan"), True, b"deg/s", [], {}, object()),
        },
    ),
    "compare": (
        lambda **given: spinfilters.compare(**(dict[str, Any](data=RECORDING) | given)),
        {
            "data": NO_PATH,
            "estimators": NO_NAMES,
            "settings": (3, 2.5, float("nan"), True, b"x.toml", "", [], ["mekf"], object()),
            "segment": (2.5, float("nan"), b"1", [], {}, object()),
            "output": but_none(NO_PATH),
            "unit": but_none(NO_TEXT),
            "clock": but_none(NO_TEXT),
            "rate": but_none(NO_NUMBER),
            "topic": but_none(NO_TEXT),
            "columns": but_none(NO_TEXT),
            "kind": but_none(NO_TEXT),
            "units": (3, 2.5, float("nan"), True, b"deg/s", [], {}, object()),
            "resume": NO_TRUTH,
            "predict": but_none(NO_NUMBER),
            "convergence": NO_TRUTH,
            "explain": NO_TRUTH,
            "progress": NO_FUNCTION,
        },
    ),
    "load_run": (spinfilters.load_run, {"folder": NO_PATH}),
    "simulate": (
        spinfilters.simulate,
        {
            "kind": NO_TEXT,
            "seed": (*NO_NUMBER, 1.5),
            "frames": (*NO_NUMBER, 1.5),
            "interval": NO_NUMBER,
            "rate_rpm": NO_THREE,
            "moments": NO_THREE,
            "known_map": NO_TRUTH,
            "gyro_bias": but_none(NO_THREE),
            "inspector": NO_TEXT,
            "beside": NO_MAPPING,
            "progress": NO_FUNCTION,
        },
    ),
    "observe": (
        spinfilters.observe,
        {
            "sensors": (None, *NO_NAMES),
            "rate_rpm": NO_THREE,
            "moments": NO_THREE,
            "frames": (*NO_NUMBER, 1.5),
            "interval": NO_NUMBER,
            "landmarks": (*NO_NUMBER, 1.5),
            "known_map": NO_TRUTH,
            "chart": NO_TEXT,
            "unknowns": NO_TEXT,
            "known": (3, "torque", [], {}),
        },
    ),
    "campaign": (
        lambda **given: spinfilters.campaign(**(dict[str, Any](study=RECORDING) | given)),
        {
            "study": (*NO_PATH[:-2], object()),
            "output": but_none(NO_PATH),
            "workers": (*but_none(NO_NUMBER), 1.5),
            "scheduler": but_none(NO_TEXT),
            "resume": NO_TRUTH,
            "progress": but_none(NO_FUNCTION),
        },
    ),
    "read_mesh": (spinfilters.read_mesh, {"path": NO_PATH}),
    "mass_properties": (spinfilters.mass_properties, {"mesh": (None, 3, "cube.stl", [], np.eye(3))}),
    "Settings": (
        spinfilters.Settings,
        {
            "estimators": (None, 3, b"mekf", [], [3], {}, object()),
            "sensors": (
                None,
                3,
                "x",
                [],
                object(),
                {"pixel_std": "x"},
                {"pixel_std": float("nan")},
                {"nonsense": 1},
            ),
            "process": (None, 3, "x", [], {"drag": "yes"}),
            "smoother": (None, 3, "x", [], object()),
        },
    ),
}
CASES = [(name, argument) for name, (_, arguments) in WRONG.items() for argument in arguments]


@pytest.mark.parametrize(("name", "argument"), CASES)
def test_a_wrong_argument_is_named_with_its_value(name: str, argument: str) -> None:
    call, arguments = WRONG[name]
    for value in arguments[argument]:
        with pytest.raises(InputError) as caught:
            call(**{argument: value})
        said = str(caught.value)
        assert argument in said or name == "Settings", f"{value!r}: {said}"
        assert len(said.splitlines()) == 1
        assert "give" in said or name == "Settings", f"{value!r}: {said}"
        assert str(RECORDING) not in said


@pytest.mark.parametrize("values", [{"torque": 3}, {"torque": None}, {"manoeuvre": [3]}, {"sizes": 3}])
def test_known_inputs_that_are_none_are_refused(values: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"torque|3"):
        spinfilters.observe("gyro", known=KnownInputs(**values))


def test_a_list_an_array_and_a_path_are_as_good_as_a_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.csv"):
        spinfilters.compare(tmp_path / "absent.csv", ["mekf"], settings={"sensors": {"pixel_std": 0.5}})
    rates: Any = np.array([1.0, 2.0, 3.0])
    dataset = spinfilters.simulate("gyro", frames=3, rate_rpm=rates, moments=[1, 1.2, 1.4])
    assert len(dataset.log.times) == 3


def test_numbers_of_numpy_are_numbers() -> None:
    numbers: dict[str, Any] = {
        "seed": np.int64(3),
        "frames": np.uint8(4),
        "interval": np.float32(0.5),
        "rate_rpm": np.array([1, 2, 3]),
        "moments": [np.int32(1), np.float32(1.25), np.longdouble(1.5)],
        "gyro_bias": (np.float16(0.5), np.array(0.25), 0),
        "beside": {"pose": np.float32(0.5)},
    }
    plain: dict[str, Any] = {
        "seed": 3,
        "frames": 4,
        "interval": 0.5,
        "rate_rpm": [1, 2, 3],
        "moments": [1, 1.25, 1.5],
        "gyro_bias": [0.5, 0.25, 0],
        "beside": {"pose": 0.5},
    }
    given, expected = spinfilters.simulate("gyro", **numbers), spinfilters.simulate("gyro", **plain)
    assert given.options == expected.options
    for own, other in zip(given.log.streams, expected.log.streams, strict=True):
        np.testing.assert_array_equal(own.values, other.values)


def test_numbers_of_numpy_are_numbers_of_every_call() -> None:
    given: Any = {"predict": np.float32(2), "segment": np.int64(1), "settings": {"smoother": {"epochs": 9}}}
    with pytest.raises(InputError, match=r"no-such|give output"):
        spinfilters.compare(RECORDING, **given)
    with pytest.raises(InputError, match="no-such"):
        spinfilters.load(RECORDING, np.int64(1), rate=np.int16(9))  # pyright: ignore[reportArgumentType]
    sizes: dict[str, Any] = {"frames": np.int16(9), "landmarks": np.array(5), "interval": np.float32(1)}
    spinfilters.observe("gyro", rate_rpm=np.float32([1, 2, 3]), **sizes)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    "error", [{"sparse": 1e9}, {"drifting": 1e300}, {"late": 11.0}, {"turning": 4.0}, {"sparse": 1e-9}]
)
def test_an_error_of_an_inspector_beyond_any_use_is_refused_before_it_is_simulated(
    error: dict[str, float],
) -> None:
    with pytest.raises(InputError, match=f"inspector error {next(iter(error))} of size .*; give a size of"):
        spinfilters.simulate(frames=10, inspector="dead-band", inspector_errors=error)


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (lambda: spinfilters.simulate("folder", kind="pose"), "kind"),  # pyright: ignore[reportCallIssue]
        (lambda: spinfilters.simulate(noise={}), "noise"),  # pyright: ignore[reportCallIssue]
    ],
)
def test_an_argument_that_does_not_fit_is_named_with_the_function_and_its_arguments(
    call: Callable[[], object], what: str
) -> None:
    with pytest.raises(
        TypeError, match=rf"^simulate\(\): .*'{what}'.*; its arguments are kind, seed, frames"
    ):
        call()
