"""Vectorised functions: the bits of CasADi's virtual machine, whatever the number of items or the machine."""

import pickle
from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from spinfilters.core import c_library
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import ShapeError
from spinfilters.core.vectorised import Vectorised, VectorisedScan, simd_text


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A machine without a compiler."""
    monkeypatch.setenv("SPINFILTERS_COMPILE", "off")
    c_library.compiler.cache_clear()
    yield
    c_library.compiler.cache_clear()


def _needs_compiler() -> None:
    if c_library.compiler() is None:
        pytest.skip("no C compiler on this machine")


def _mixed() -> ca.Function:
    """Two columns in, a column and a number out, with one of nearly every operation that a sensor or an integrator uses."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    waves = ca.vertcat(ca.sin(x[0]) + ca.cos(x[1]), ca.tan(p[0]), ca.atan2(x[0], x[2]), ca.atan(x[1]))
    powers = ca.vertcat(
        ca.sqrt(x[0] ** 2 + 1), ca.exp(-p[1]), ca.log(ca.fabs(x[2]) + 1), ca.fabs(x[0]) ** 1.7
    )
    choices = ca.vertcat(
        ca.fmax(x[0], p[0]),
        ca.fmin(x[1], p[1]),
        ca.if_else(x[0] < p[0], 2 * x[1], x[2] / p[1]),
        ca.sign(x[1]),
        ca.copysign(p[0], x[2]),
        ca.if_else(ca.logic_and(x[0] <= 0, ca.logic_not(x[1] == 0)), 1 / p[0], 3.25),
    )
    return ca.Function("mixed_lanes", [x, p], [ca.vertcat(waves, powers, choices), ca.dot(x, x) - p[0]])


def _numbers(count: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(count)
    return generator.standard_normal((count, 3)), 0.5 + generator.random((count, 2))


def _logarithms() -> ca.Function:
    """Outputs that are logarithms, one that stands twice, and one that is used besides."""
    x = ca.SX.sym("x", 3)
    one, used = ca.log(x[0] * x[1]), ca.log(x[2])
    return ca.Function(
        "logarithms", [x], [ca.vertcat(x[1], one), used, used * x[0], ca.log(ca.log(1 + x[1]))]
    )


@pytest.mark.parametrize("count", [1, 9, 16])
def test_logarithms_behind_the_loop_have_the_bits_of_those_within(count: int) -> None:
    x = _numbers(count)[0] ** 2
    vectorised, plain = Vectorised(_logarithms()), Compiled.interpreted(_logarithms())
    for found, expected in zip(vectorised(x, rows=(None,)), plain(x), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 16, 61])
def test_vectorised_functions_give_the_bits_of_the_virtual_machine(count: int) -> None:
    vectorised, plain = Vectorised(_mixed()), Compiled.interpreted(_mixed())
    arguments = _numbers(count)
    for found, expected in zip(vectorised(*arguments, rows=(None, None)), plain(*arguments), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_vectorised_functions_give_the_bits_of_the_virtual_machine_where_numbers_are_not_ordinary() -> None:
    special = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 1e308, -1e-308, 1.0])
    x = np.array(np.meshgrid(special, special, special)).reshape(3, -1).T.copy()
    p = np.tile([[0.75, -0.5]], (len(x), 1))
    found = Vectorised(_mixed())(x, p, rows=(None, None))
    for here, expected in zip(found, Compiled.interpreted(_mixed())(x, p), strict=True):
        np.testing.assert_array_equal(here, expected)


def test_rows_choose_what_an_item_takes() -> None:
    x, p = _numbers(6)
    row = np.array([5, 0, 0, 3, 5, 2, 1, 4, 4, 0])
    wide = np.concatenate([p, p])[: len(row)]
    found = Vectorised(_mixed())(x, wide, rows=(row, None))
    for here, expected in zip(found, Compiled.interpreted(_mixed())(x[row], wide), strict=True):
        np.testing.assert_array_equal(here, expected)


@pytest.mark.parametrize("build", ["C", "interpreted"])
def test_no_items_give_no_rows(build: str, request: pytest.FixtureRequest) -> None:
    if build == "interpreted":
        request.getfixturevalue("no_compiler")
    values, number = Vectorised(_mixed())(*_numbers(0), rows=(None, None))
    assert values.shape == (0, 14)
    assert number.shape == (0, 1)


def test_no_rows_of_something_give_no_rows() -> None:
    none = np.zeros(0, dtype=int)
    values, _ = Vectorised(_mixed())(_numbers(4)[0], _numbers(0)[1], rows=(none, None))
    assert values.shape == (0, 14)


@pytest.mark.parametrize(
    ("x", "p", "rows", "complaint"),
    [
        ((4, 2), (4, 2), (None, None), r"shape \(k, 3\) is \(4, 2\)"),
        ((3,), (4, 2), (None, None), r"shape \(k, 3\) is \(3,\)"),
        ((4, 3), (5, 2), (None, None), r"\[4, 5\] items"),
        ((4, 3), (3, 2), (np.array([0, 1, 4]), None), "rows 0 to 4 of 4"),
        ((4, 3), (3, 2), (np.array([0, -1, 2]), None), "rows -1 to 2 of 4"),
        ((0, 3), (1, 2), (np.array([0]), None), "rows 0 to 0 of 0"),
        ((4, 3), (4, 2), (None,), "2 arguments with rows for each"),
    ],
)
def test_a_wrong_shape_is_named(
    x: tuple[int, ...], p: tuple[int, ...], rows: tuple[np.ndarray | None, ...], complaint: str
) -> None:
    with pytest.raises(ShapeError, match=complaint):
        Vectorised(_mixed())(np.zeros(x), np.zeros(p), rows=rows)


def test_a_missing_argument_is_named() -> None:
    with pytest.raises(ShapeError, match="2 arguments"):
        Vectorised(_mixed())(np.zeros((4, 3)), rows=(None,))


def test_arguments_need_not_be_contiguous_floats() -> None:
    x, _ = _numbers(20)
    vectorised = Vectorised(_mixed())
    expected = vectorised(x[::2].copy(), np.ones((10, 2)), rows=(None, None))
    found = vectorised(x[::2], np.ones((2, 10), dtype=int).T, rows=(None, None))
    for here, there in zip(found, expected, strict=True):
        np.testing.assert_array_equal(here, there)


def test_results_share_no_memory_with_later_calls() -> None:
    vectorised = Vectorised(_mixed())
    first = vectorised(*_numbers(5), rows=(None, None))[0]
    kept = first.copy()
    vectorised(*(3 * part for part in _numbers(5)), rows=(None, None))
    np.testing.assert_array_equal(first, kept)


def test_vectorised_functions_survive_pickling() -> None:
    vectorised = Vectorised(_mixed())
    before = vectorised(*_numbers(9), rows=(None, None))
    after = pickle.loads(pickle.dumps(vectorised))(*_numbers(9), rows=(None, None))
    for here, there in zip(before, after, strict=True):
        np.testing.assert_array_equal(here, there)


def _unknown_operation() -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function("unknown_operation", [x], [ca.erf(x)])


def test_an_operation_that_is_not_known_is_left_to_casadi() -> None:
    assert simd_text(_unknown_operation()) is None
    x = np.linspace(-2, 2, 22).reshape(11, 2)
    (found,) = Vectorised(_unknown_operation())(x, rows=(None,))
    np.testing.assert_array_equal(found, Compiled.interpreted(_unknown_operation())(x)[0])


def test_a_function_that_is_no_expression_of_scalars_is_left_to_casadi() -> None:
    x = ca.MX.sym("x", 2)
    function = ca.Function("matrices_inside", [x], [ca.solve(ca.MX.eye(2) * 4, x)])
    assert simd_text(function) is None
    numbers = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(Vectorised(function)(numbers, rows=(None,))[0], numbers / 4)


def test_known_operations_are_written_out_in_c() -> None:
    text = simd_text(_mixed())
    assert text is not None
    assert "omp simd" in text


def test_without_a_compiler_vectorised_functions_give_the_same_bits(no_compiler: None) -> None:
    x, p = _numbers(13)
    row = np.array([0, 12, 3, 3])
    found = Vectorised(_mixed())(x, p[:4], rows=(row, None))
    for here, expected in zip(found, Compiled.interpreted(_mixed())(x[row], p[:4]), strict=True):
        np.testing.assert_array_equal(here, expected)


def _matrices() -> ca.Function:
    A, v = ca.SX.sym("A", 2, 3), ca.SX.sym("v", 3)
    return ca.Function("matrix_lanes", [A, v], [A @ v, A @ ca.diag(v)])


def _columns_of_matrices() -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """A v and A diag(v) as found, and as expected."""
    generator = np.random.default_rng(2)
    A, v = generator.standard_normal((5, 2, 3)), generator.standard_normal((5, 3))
    found = Vectorised(_matrices())(A.swapaxes(1, 2).reshape(5, 6).copy(), v, rows=(None, None))
    return found, (np.einsum("kij,kj->ki", A, v), (A * v[:, None]).swapaxes(1, 2).reshape(5, 6))


def test_matrices_go_in_and_come_out_column_by_column() -> None:
    (product, scaled), expected = _columns_of_matrices()
    np.testing.assert_allclose(product, expected[0], rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(scaled, expected[1])


def test_matrices_go_in_and_come_out_column_by_column_without_a_compiler(no_compiler: None) -> None:
    (product, scaled), expected = _columns_of_matrices()
    np.testing.assert_allclose(product, expected[0], rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(scaled, expected[1])


def _pendulum() -> tuple[ca.Function, ca.Function, ca.Function]:
    """Begins at (angle, 0), swings with steps of another length in every turn, and ends as (swing, rate) beside the angle."""
    angle, p, y = ca.SX.sym("angle"), ca.SX.sym("p", 2), ca.SX.sym("y", 2)
    same, numbers = ca.SX.sym("same"), ca.SX.sym("numbers", 2)
    begin = ca.Function("begin", [angle, p], [ca.vertcat(angle, 0), p[0] * p[1]])
    moved = y + numbers[0] * ca.vertcat(y[1], -same * ca.sin(y[0])) + numbers[1]
    turn = ca.Function("pendulum", [y, same, numbers], [moved])
    return begin, turn, ca.Function("end", [angle, p, y], [y, y[0] - angle * p[1]])


def _swinging(count: int) -> tuple[np.ndarray, np.ndarray]:
    x, p = _numbers(count)
    return np.ascontiguousarray(x[:, :1]), np.ascontiguousarray(p[:, :2])


def _folded(angle: np.ndarray, p: np.ndarray, each: np.ndarray) -> tuple[np.ndarray, ...]:
    begin, turn, end = map(Compiled.interpreted, _pendulum())
    y, same = begin(angle, p)
    for numbers in each:
        (y,) = turn(y, same, numbers)
    return end(angle, p, y)


EACH = np.array([[0.1, 0.0], [0.2, 0.1], [0.05, -0.3], [0.3, 0.0], [0.1, 0.2]])


def _same(found: tuple[np.ndarray, ...], expected: tuple[np.ndarray, ...]) -> bool:
    """Whether both are as many arrays, equal to the bit."""
    return all(np.array_equal(one, other) for one, other in zip(found, expected, strict=True))


@pytest.mark.parametrize("turns", [0, 1, 5])
@pytest.mark.parametrize("count", [1, 8, 13])
def test_a_fold_is_its_functions_one_after_the_other_to_the_bit(count: int, turns: int) -> None:
    arguments = _swinging(count)
    assert _same(
        VectorisedScan(*_pendulum())(*arguments, each=EACH[:turns]), _folded(*arguments, EACH[:turns])
    )


def test_a_fold_of_nothing_gives_nothing() -> None:
    assert [part.shape for part in VectorisedScan(*_pendulum())(*_swinging(0), each=EACH)] == [(0, 2), (0, 1)]


def test_a_fold_leaves_its_arguments_alone() -> None:
    angle, p = _swinging(3)
    before = angle.copy(), p.copy()
    VectorisedScan(*_pendulum())(angle, p, each=EACH)
    assert _same((angle, p), before)


def test_a_column_of_a_fold_may_be_the_same_for_all_items() -> None:
    angle, p = _swinging(11)
    assert _same(
        VectorisedScan(*_pendulum())(angle, p[:1], each=EACH),
        VectorisedScan(*_pendulum())(angle, np.tile(p[:1], (11, 1)), each=EACH),
    )


@pytest.mark.parametrize("shape", [(4, 3), (4,), (3, 2)])
def test_columns_that_do_not_fit_a_fold_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ShapeError, match="pendulum"):
        VectorisedScan(*_pendulum())(np.zeros((4, 1)), np.zeros(shape), each=EACH)


@pytest.mark.parametrize("shape", [(3,), (3, 1), (3, 3)])
def test_numbers_that_do_not_fit_the_turns_of_a_fold_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ShapeError, match="2 numbers for every turn"):
        VectorisedScan(*_pendulum())(*_swinging(4), each=np.zeros(shape))


def test_without_a_compiler_a_fold_gives_the_same_bits(no_compiler: None) -> None:
    arguments = _swinging(5)
    assert _same(VectorisedScan(*_pendulum())(*arguments, each=EACH), _folded(*arguments, EACH))


def test_a_fold_survives_pickling() -> None:
    scan, arguments = VectorisedScan(*_pendulum()), _swinging(3)
    before = scan(*arguments, each=EACH)
    assert _same(pickle.loads(pickle.dumps(scan))(*arguments, each=EACH), before)


def test_vectorised_functions_are_compiled_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    _needs_compiler()
    monkeypatch.setenv("SPINFILTERS_CACHE", str(tmp_path))
    Vectorised(_mixed())(*_numbers(3), rows=(None, None))
    (library,) = tmp_path.glob("mixed_lanes_lanes*.so")
    Vectorised(_mixed())(*_numbers(4), rows=(None, None))
    assert list(tmp_path.glob("*.so")) == [library]
