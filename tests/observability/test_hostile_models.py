"""Models of a user that are wrong are refused in one line that names the place and the cure."""

from pathlib import Path
from typing import Any

import casadi as ca
import pytest

from observability.bound_section import stated_bound
from observability.model_analysis import analyse, read_model
from spinfilters.core.errors import InputError

GOOD = """
states = ["x", "v"]
parameters = ["k"]
inputs = ["F"]
[equations]
x = "v"
v = "F - k*x"
[outputs]
y = "x"
"""

HOSTILE = [
    ("unknown name", GOOD.replace("k*x", "k*z"), "the equation of v: 'z' is unknown; declare it"),
    ("no equation", GOOD.replace('x = "v"\n', ""), "the state 'x' has no equation; add one"),
    (
        "equation of no state",
        GOOD.replace("[outputs]", 'q = "1"\n[outputs]'),
        "the equation of 'q' is of no state",
    ),
    ("no output", GOOD.replace('y = "x"', ""), "nothing is measured; give at least one output"),
    ("no states", GOOD.replace('["x", "v"]', "[]"), "the equation of 'x' is of no state"),
    ("division by 0", GOOD.replace("k*x", "k/0"), "something is divided by 0"),
    ("division by 0 everywhere", GOOD.replace("k*x", "1/(k - k)"), "divi"),
    (
        "division by 0 at the point",
        GOOD.replace("k*x", "k/x") + "[point]\nx = 0\n",
        "no point was found with these values",
    ),
    ("root of a negative number", GOOD.replace("k*x", "sqrt(-1 - 0*x)"), "sqrt has no finite value here"),
    ("logarithm of 0 at the point", GOOD.replace("k*x", "log(x)") + "[point]\nx = 0\n", "no point was found"),
    (
        "a list for a table",
        'outputs = ["x"]\n' + GOOD.replace('[outputs]\ny = "x"', ""),
        "outputs is",
    ),
    ("a name for a list", GOOD.replace('parameters = ["k"]', 'parameters = "k"'), "give a list of names"),
    ("a number for a name", GOOD.replace('["k"]', "[3]"), "3 is no name"),
    ("a function's name", GOOD.replace('["k"]', '["sin"]').replace("k*x", "x"), "'sin' is no name"),
    ("a name twice", GOOD.replace('["k"]', '["k", "x"]'), "'x' is declared twice"),
    (
        "a formula that is a date",
        GOOD.replace('"F - k*x"', "2024-01-01"),
        "give a formula in quotes, or a number",
    ),
    ("a formula that is true", GOOD.replace('"F - k*x"', "true"), "give a formula in quotes"),
    ("an open parenthesis", GOOD.replace("k*x", "(k*x"), "a parenthesis is not closed"),
    ("an operator too much", GOOD.replace("k*x", "k*/x"), "'/' is not expected here"),
    ("an end too early", GOOD.replace("k*x", "k*"), "it ends where something is still expected"),
    ("an empty formula", GOOD.replace("F - k*x", ""), "it ends where something is still expected"),
    ("an unknown function", GOOD.replace("k*x", "erf(x)"), "the function 'erf' is unknown; use one of"),
    ("too many arguments", GOOD.replace("k*x", "sin(x, k)"), "sin takes 1 argument, got 2"),
    ("code", GOOD.replace("k*x", "__import__('os')"), "has no meaning here"),
    ("an attribute", GOOD.replace("k*x", "x.real"), "has no meaning here"),
    (
        "a huge power",
        GOOD.replace("k*x", "x**99999999999999999999999999999999999999999999999999999999999999"),
        "too long",
    ),
    ("a large exponent", GOOD.replace("k*x", "1e999"), "too long; keep it between"),
    (
        "deep parentheses",
        GOOD.replace("k*x", "(" * 500 + "x" + ")" * 500),
        "parentheses lie within one another",
    ),
    ("a long formula", GOOD.replace("k*x", "+".join(["x"] * 20000)), "characters; give at most"),
    ("an unknown key", 'sttaes = ["q"]\n' + GOOD, "'sttaes' is unknown; use states"),
    ("a point of no name", GOOD + "[point]\nq = 1\n", "the point names 'q'"),
    (
        "a point that is a word",
        GOOD + '[point]\nx = "one"\n',
        "which is no number; give one such as 0.5 or 3/2",
    ),
    (
        "an initial value of no state",
        GOOD + "[known_initial_values]\nk = 1\n",
        "the known initial value of 'k' is of no state",
    ),
    ("an initial value of a state", GOOD + '[known_initial_values]\nx = "v"\n', "'v' is unknown"),
    ("two values of a state", GOOD + "[known_initial_values]\nx = 1\n[point]\nx = 1\n", "give one of them"),
    ("too many names", GOOD.replace('["k"]', str([f"k{i}" for i in range(500)] + ["k"])), "give at most 400"),
    ("no TOML", "states = [", "is not TOML"),
    ("bytes", "\x00\x01", "is not TOML"),
    ("an endless power", GOOD.replace("k*x", "x**x**x**x**x"), None),
    ("a bound that is a number", "bound = 3\n" + GOOD, "bound is 3; give a table"),
    (
        "experiments that are a list",
        "experiments = [1]\n" + GOOD,
        "give a table by the name of each experiment",
    ),
    ("a course that is unknown", GOOD + '[courses]\nF = "u"\n', "'u' is unknown"),
    (
        "a clock twice",
        GOOD.replace('"k"', '"t"').replace("k*x", "t*x") + '[courses]\nF = "sin(t)"\n',
        "is the time in courses",
    ),
]


def _asked(path: Path) -> None:
    document = read_model(path)
    analyse(document, name=path.name)
    stated_bound(document, path.name, path.parent)


@pytest.mark.parametrize(("text", "words"), [each[1:] for each in HOSTILE], ids=[each[0] for each in HOSTILE])
def test_a_hostile_model_is_one_line(tmp_path: Path, text: str, words: str | None) -> None:
    path = tmp_path / "model.toml"
    path.write_text(text)
    if words is None:  # odd, and nothing is wrong with it
        analyse(read_model(path), name=path.name)
        return
    with pytest.raises(InputError) as caught:
        _asked(path)
    complaint = str(caught.value)
    assert words in complaint
    assert "model.toml" in complaint
    assert "\n" not in complaint
    assert len(complaint) < 400


@pytest.mark.parametrize(
    ("formula", "words"),
    [
        ("0,5*x", "',' is not expected here; write numbers with a decimal point"),
        ("min(,x)", "',' is not expected here; write numbers"),
        ("2 x", "'x' is not expected here; write an operator such as"),
        ("x + * v", r"'\*' is not expected here; write a name, a number"),
        ("x)", r"'\)' is not expected here; leave it out"),
        ("x < 2", "'<' has no meaning here; use names, numbers"),
        ("x/0", "something is divided by 0; change the divisor"),
        ("x +", "it ends where something is still expected; complete it"),
    ],
)
def test_a_formula_that_cannot_be_read_has_its_cure(formula: str, words: str) -> None:
    document = {"states": ["x", "v"], "equations": {"x": "v", "v": formula}, "outputs": {"y": "x"}}
    with pytest.raises(InputError, match=f"the equation of v: {words}"):
        analyse(document)


X, SECOND, OTHER_KIND = ca.SX.sym("x"), ca.SX.sym("x"), ca.MX.sym("x")


@pytest.mark.parametrize(
    ("given", "roles", "words"),
    [
        ((OTHER_KIND, OTHER_KIND, OTHER_KIND), {}, "x is MX.*; give casadi.SX symbols"),
        ((OTHER_KIND, X, X), {}, "f is MX.*; give a casadi.SX expression"),
        ((X, X, X), {"parameters": OTHER_KIND}, "parameters is MX.*; give casadi.SX symbols"),
        ((SECOND, X, X), {}, "'x' is in f or h as a second symbol of this name; make each symbol once"),
        ((X, X, X), {"params": SECOND}, "'params' is no role of symbols; use parameters, inputs"),
        ((X, X, X), {"at": [1]}, "at is .1.; give a dictionary of values by name"),
        ((X, X, X), {"known_initial_values": [1]}, "known_initial_values is .1.; give a dictionary"),
        ((X, X, 5), {}, "x is 5; give casadi.SX symbols"),
        ((X, [None], X), {}, "h is .None.; give a casadi.SX expression"),
    ],
)
def test_wrong_expressions_are_one_line_with_the_cure(
    given: tuple[Any, ...], roles: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words) as caught:
        analyse(*given, **roles)
    assert "\n" not in str(caught.value)
