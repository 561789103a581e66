"""Compiled functions: shapes, batches, processes, and C that rounds like CasADi's virtual machine."""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from spinfilters.core import attitude_expressions as expressions
from spinfilters.core import c_library, compiled
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import ShapeError


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache folder of this test alone, with the compiler looked up afresh before and after."""
    monkeypatch.setenv("SPINFILTERS_CACHE", str(tmp_path))
    monkeypatch.delenv("SPINFILTERS_COMPILE", raising=False)
    c_library.compiler.cache_clear()
    yield tmp_path
    c_library.compiler.cache_clear()


@pytest.fixture
def c_compiler(own_cache: Path) -> str:
    cc = c_library.compiler()
    if cc is None:
        pytest.skip("no C compiler on this machine")
    return cc


def _affine_function() -> ca.Function:
    """Two matrices (one not square, one sparse), a vector, a number, of a matrix, a vector and a number."""
    A, v, s = ca.SX.sym("A", 2, 3), ca.SX.sym("v", 3), ca.SX.sym("s")
    return ca.Function(
        "affine", [A, v, s], [s * A, ca.diag(v), A @ v + s, ca.dot(v, v)], ["A", "v", "s"], list("wxyz")
    )


def _expected(A: np.ndarray, v: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, ...]:
    """The same in NumPy; the number has shape (*batch, 1)."""
    product = np.einsum("...ij,...j->...i", A, v) + s
    return (
        s[..., np.newaxis] * A,
        v[..., np.newaxis] * np.eye(3),
        product,
        np.sum(v * v, axis=-1, keepdims=True),
    )


def _arguments(*shape: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    return rng.normal(size=(*shape, 2, 3)), rng.normal(size=(*shape, 3)), rng.normal(size=(*shape, 1))


@pytest.fixture(params=[Compiled, Compiled.interpreted], ids=["compiled", "interpreted"])
def affine(request: pytest.FixtureRequest) -> Compiled:
    return request.param(_affine_function())


@pytest.mark.parametrize("shape", [(), (1,), (4,), (2, 3), (0,), (2, 0, 3)])
def test_outputs_have_the_batch_axes_in_front(affine: Compiled, shape: tuple[int, ...]) -> None:
    arguments = _arguments(*shape)
    for found, expected in zip(affine(*arguments), _expected(*arguments), strict=True):
        assert found.shape[: len(shape)] == shape
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=1e-14, atol=1e-15)


def test_batch_axes_broadcast_against_one_another(affine: Compiled) -> None:
    A, v, s = _arguments(4, 1)[0], _arguments(5)[1], _arguments()[2]
    found = affine(A, v, s)
    assert found[0].shape == (4, 5, 2, 3)
    for i, j in np.ndindex(4, 5):
        for batch, single in zip(found, affine(A[i, 0], v[j], s), strict=True):
            np.testing.assert_array_equal(batch[i, j], single)


def test_numbers_integers_and_views_are_arguments_too(affine: Compiled) -> None:
    A = np.asfortranarray(np.arange(6).reshape(2, 3))
    v = np.arange(12.0)[::4]
    v.flags.writeable = False
    expected = _expected(A.astype(float), v, np.array([2.0]))
    for s in (2, 2.0, np.float64(2), np.array(2.0), np.array([2])):
        for found, value in zip(affine(A, v, s), expected, strict=True):
            np.testing.assert_array_equal(found, value)


def test_a_batch_is_read_alike_in_place_read_only_or_strided(affine: Compiled) -> None:
    _, v, s = _arguments(6)
    A = _arguments()[0]
    fixed = v.copy()
    fixed.flags.writeable = False
    strided = np.concatenate([v, v], axis=1)[:, :3]
    expected = affine(A, v, s)
    for rows in (fixed, strided, np.asfortranarray(v), v.astype(np.longdouble)):
        for found, value in zip(affine(A, rows, s), expected, strict=True):
            np.testing.assert_array_equal(found, value)


def test_vectors_alone_give_a_batch_of_matrices() -> None:
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    points, fixed = np.random.default_rng(1).normal(size=(5, 3)), np.array([2.0, 3.0])
    fixed.flags.writeable = False
    for build in (Compiled, Compiled.interpreted):
        (outer,) = build(ca.Function("outer", [x, y], [x @ y.T]))(points, fixed)
        np.testing.assert_array_equal(outer, points[:, :, np.newaxis] * fixed)


def test_outputs_share_no_memory_with_later_calls(affine: Compiled) -> None:
    first = affine(*_arguments())
    kept = [value.copy() for value in first]
    affine(*(2 * argument for argument in _arguments()))
    for value, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(value, copy)


@pytest.mark.parametrize(
    ("replace", "text"),
    [
        ({0: np.zeros((3, 2))}, r"A must end in shape \(2, 3\), got \(3, 2\)"),
        ({1: np.zeros((3, 1))}, r"v must end in shape \(3,\), got \(3, 1\)"),
        ({1: 1.0}, r"v must end in shape \(3,\), got \(\)"),
        ({2: np.zeros(2)}, r"s must end in shape \(1,\), got \(2,\)"),
        ({0: np.zeros((2, 2, 3)), 1: np.zeros((3, 3))}, "batch axes do not broadcast"),
    ],
)
def test_a_wrong_shape_is_named(affine: Compiled, replace: dict[int, np.ndarray], text: str) -> None:
    arguments = [replace.get(k, argument) for k, argument in enumerate(_arguments())]
    with pytest.raises(ShapeError, match=text):
        affine(*arguments)


@pytest.mark.parametrize("count", [0, 2, 4])
def test_a_wrong_number_of_arguments_is_refused(affine: Compiled, count: int) -> None:
    with pytest.raises(ShapeError, match=f"takes 3 arguments, got {count}"):
        affine(*[np.zeros((2, 3))] * count)


def test_a_function_survives_pickling(affine: Compiled) -> None:
    before = affine(*_arguments(4))
    copy = pickle.loads(pickle.dumps(affine))
    assert copy.is_c == affine.is_c
    for one, other in zip(before, copy(*_arguments(4)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_mx_functions_are_served_like_sx_functions() -> None:
    x = ca.MX.sym("x", 3)
    square = Compiled.interpreted(ca.Function("square", [x], [x @ x.T, ca.solve(ca.MX.eye(3) * 2, x)]))
    points = np.random.default_rng(0).normal(size=(5, 3))
    outer, half = square(points)
    np.testing.assert_array_equal(outer, points[:, :, np.newaxis] * points[:, np.newaxis])
    np.testing.assert_array_equal(half, points / 2)


def test_more_batch_sizes_than_are_remembered_all_work() -> None:
    affine = Compiled.interpreted(_affine_function())
    for count in (*range(80), 3):
        assert affine(*_arguments(count))[0].shape == (count, 2, 3)


def _everything(q: ca.SX, r: ca.SX) -> list[ca.SX]:
    p = expressions.product(q, expressions.quaternion_from_rotation_vector(r))
    derivative = ca.jacobian(expressions.rotation_vector_from_quaternion(p), r)
    return [p, expressions.mrp_from_quaternion(p), derivative, expressions.angle_between(q, p)]


def test_c_rounds_like_the_virtual_machine(c_compiler: str) -> None:
    q, r = ca.SX.sym("q", 4), ca.SX.sym("r", 3)
    function = ca.Function("everything", [q, r], _everything(q, r))
    fast, slow = Compiled(function), Compiled.interpreted(function)
    rng = np.random.default_rng(0)
    q_values = rng.normal(size=(500, 4))
    q_values /= np.linalg.norm(q_values, axis=-1, keepdims=True)
    r_values = rng.normal(size=(500, 3)) * np.logspace(-9, 0.5, 500)[:, np.newaxis]
    assert fast.is_c
    assert not slow.is_c
    for one, other in zip(fast(q_values, r_values), slow(q_values, r_values), strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(fast(q_values[0], r_values[0]), slow(q_values[0], r_values[0]), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_second_use_compiles_nothing(
    c_compiler: str, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert Compiled(_affine_function()).is_c
    (library,) = own_cache.glob("*.so")
    monkeypatch.setattr(c_library, "_compile", _no_compilation)
    assert Compiled(_affine_function()).is_c
    assert list(own_cache.iterdir()) == [library]


def test_an_interpreted_function_compiles_nothing(own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(c_library, "_compile", _no_compilation)
    function = Compiled.interpreted(_affine_function())
    function(*_arguments())
    assert not function.is_c
    assert not list(own_cache.iterdir())


def _no_compilation(*_: object) -> None:
    raise AssertionError("the compiler was called")


def test_another_expression_of_the_same_name_has_its_own_library(c_compiler: str) -> None:
    x = ca.SX.sym("x")
    twice, thrice = (Compiled(ca.Function("f", [x], [factor * x])) for factor in (2, 3))
    assert twice.is_c
    assert thrice.is_c
    assert (twice(1.0)[0][0], thrice(1.0)[0][0]) == (2.0, 3.0)


def _switched_off(patch: pytest.MonkeyPatch, _: Path) -> None:
    patch.setenv("SPINFILTERS_COMPILE", "off")


def _no_compiler_found(patch: pytest.MonkeyPatch, folder: Path) -> None:
    patch.delenv("CC", raising=False)
    patch.setenv("PATH", str(folder))


def _compiler_that_fails(patch: pytest.MonkeyPatch, folder: Path) -> None:
    broken = folder / "broken-cc"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    patch.setenv("CC", str(broken))


def _cache_that_cannot_be_made(patch: pytest.MonkeyPatch, folder: Path) -> None:
    (folder / "file").touch()
    patch.setenv("SPINFILTERS_CACHE", str(folder / "file" / "cache"))


@pytest.mark.parametrize(
    "trouble", [_switched_off, _no_compiler_found, _compiler_that_fails, _cache_that_cannot_be_made]
)
def test_without_c_the_virtual_machine_gives_the_numbers(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch, trouble: Callable[[pytest.MonkeyPatch, Path], None]
) -> None:
    trouble(monkeypatch, own_cache)
    c_library.compiler.cache_clear()
    function = Compiled(_affine_function())
    assert not function.is_c
    np.testing.assert_allclose(function(*_arguments(4))[2], _expected(*_arguments(4))[2], rtol=1e-14)


@pytest.mark.parametrize("damage", ["empty", "cut short", "one bit flipped", "zeros"])
def test_a_damaged_library_is_rebuilt_once(
    c_compiler: str, own_cache: Path, damage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    function = _successor()
    library = _library_of(function, own_cache)
    whole = library.read_bytes()
    flipped = bytes([*whole[:-1], whole[-1] ^ 1])
    damaged = {
        "empty": b"",
        "cut short": whole[:-1000],
        "one bit flipped": flipped,
        "zeros": b"\0" * len(whole),
    }
    library.write_bytes(damaged[damage])
    rebuilt = Compiled(function)
    assert rebuilt.is_c
    assert rebuilt(1.0)[0][0] == 2.0
    monkeypatch.setattr(c_library, "_compile", _no_compilation)
    assert Compiled(function).is_c


def test_a_damaged_library_that_cannot_be_rebuilt_is_interpreted(
    c_compiler: str, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    function = _successor()
    _library_of(function, own_cache).write_bytes(b"")
    monkeypatch.setattr(c_library, "_compile", _full_disk)
    fallen_back = Compiled(function)
    assert not fallen_back.is_c
    assert fallen_back(1.0)[0][0] == 2.0


def _full_disk(*_: object) -> None:
    raise OSError("disk full")


def _successor() -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("successor", [x], [x + 1])


def _library_of(function: ca.Function, folder: Path) -> Path:
    """Compiled by another process, because a file that this one has mapped must not be changed."""
    call = "import pickle, sys; assert pickle.load(sys.stdin.buffer).is_c"
    subprocess.run([sys.executable, "-c", call], input=pickle.dumps(Compiled(function)), check=True)
    (library,) = folder.glob("*.so")
    return library


@pytest.mark.usefixtures("c_compiler")
def test_a_late_function_is_compiled_once_a_compiler_would_have_repaid_and_keeps_its_numbers(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiled, "WORTH_COMPILING", 10)
    function, arguments = Compiled.late(_affine_function()), _arguments(8)
    first = function(*arguments)
    assert not list(own_cache.rglob("*.so"))
    function(*arguments)
    assert list(own_cache.rglob("*.so"))
    assert all(map(np.array_equal, first, function(*arguments)))


@pytest.mark.usefixtures("c_compiler")
def test_first_items_are_interpreted_and_a_library_that_is_there_is_taken_at_once(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    function, arguments = Compiled(_affine_function(), patience=10), _arguments(8)
    first = function(*arguments)
    assert not list(own_cache.iterdir())
    function(*arguments)
    assert list(own_cache.glob("*.so"))
    monkeypatch.setattr(c_library, "_compile", _no_compilation)
    monkeypatch.setattr(Compiled, "_interpret", _no_compilation)
    for each in (function, Compiled(_affine_function(), patience=10)):
        assert all(map(np.array_equal, first, each(*arguments)))


@pytest.mark.usefixtures("c_compiler")
def test_a_batch_whose_first_items_were_interpreted_goes_on_in_c(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiled, "MOST_MAPPED", 4)
    A, v, s = _arguments(11)
    expected = Compiled.interpreted(_affine_function())(A, v[0], s)
    found = Compiled(_affine_function(), patience=5)(A, v[0], s)
    assert list(own_cache.glob("*.so"))
    assert all(map(np.array_equal, found, expected))


def test_processes_that_need_one_library_at_once_build_it_once(own_cache: Path, c_compiler: str) -> None:
    slow, calls, cache = own_cache / "slow-cc", own_cache / "calls", own_cache / "cache"
    slow.write_text(f'#!/bin/sh\necho >>{calls}\nsleep 0.3\nexec {c_compiler} "$@"\n')
    slow.chmod(0o755)
    begin = "import pickle, sys; function = pickle.load(sys.stdin.buffer); print(flush=True); sys.stdin.buffer.read()"
    environment = os.environ | {"CC": str(slow), "SPINFILTERS_CACHE": str(cache)}
    command = [sys.executable, "-c", f"{begin}; assert function.is_c"]
    builders = [
        subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for _ in range(2)
    ]
    for builder in builders:
        assert builder.stdin
        assert builder.stdout
        builder.stdin.write(pickle.dumps(Compiled(_successor())))
        builder.stdin.flush()
        builder.stdout.readline()  # both have imported all that they need
    for builder in builders:
        builder.communicate()
    assert [builder.returncode for builder in builders] == [0, 0]
    assert calls.read_text() == "\n"
    assert [path.suffix for path in cache.iterdir()] == [".so"]
