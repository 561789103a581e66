"""Hostile models of ``observe MODEL.toml``: huge exponents, deep nesting, code, unknown names, divisions by zero.

python -m tests.hostile.equations --verbose
"""

from collections.abc import Iterator, Sequence

from .attacks import no_files
from .campaign import campaign, parser
from .case import Case
from .changes import content, instead

OBSERVE = ("observe", "{in}/m.toml", "-o", "{out}/made")
MODEL = """states = ["x1", "x2"]
parameters = ["p1", "p2"]
[equations]
x1 = "%s"
x2 = "-p2*x2"
[outputs]
y = "x1"
"""
BOMB = "1e" + "9" * 9
"""A number that takes gigabytes as a fraction."""
FORMULAS = {
    "a power of 1e9": "-p1*x1^1e9",
    "a power of 1e30": "-p1*x1^1e30",
    "a power of -1e9": "-p1*x1^(-1e9)",
    "a power of 12345.678": "-p1*x1^12345.678",
    "a tower of powers": "-p1*x1" + "^30" * 12,
    "a tower of unknowns": "x1" + "^p1" * 90,
    "a number of 400 digits": "-p1*x1*" + "9" * 400,
    "a number of 1e400": "-p1*x1*1e400",
    "a long exponent": "-p1*x1*1e" + "9" * 5000,
    "parentheses without end": "(" * 5000 + "x1" + ")" * 5000,
    "signs without end": "-" * 15_000 + "x1",
    "functions within one another": "sin(" * 90 + "x1" + ")" * 90,
    "functions within one another without end": "sin(" * 4000 + "x1" + ")" * 4000,
    "squares of squares": "((((((((((x1+p1)^2+p2)^2+p1)^2+p2)^2+p1)^2+p2)^2+p1)^2+p2)^2+p1)^2+p2)^2",
    "a sum of 4000 terms": "+".join(["p1*x1"] * 3000),
    "code": "__import__('os').system('id')",
    "code without quotes": "__import__(os)",
    "an attribute": "x1.__class__",
    "an index": "x1[0]",
    "a lambda": "lambda: x1",
    "an unknown name": "-p1*x3",
    "an unknown function": "gamma(x1)",
    "a name of Python": "None*x1",
    "other letters": "-p1*х1",
    "other digits": "-p1*x1^٢",
    "an underscore in a number": "1_0*x1",
    "NUL": "x1\\u0000",
    "a line feed": "x1\\n+p1",
    "a division by 0": "x1/0",
    "a division by what is 0": "x1/(p1-p1)",
    "a logarithm of 0": "log(0)*x1",
    "a root of a negative number": "sqrt(0-4)*x1",
    "0 to the power of -1": "0^(-1)*x1",
    "0 to the power of 0": "0^0*x1",
    "an arc sine of 2": "asin(2)*x1",
    "nothing": "",
    "an operator alone": "*",
    "two numbers": "2 3",
    "an open parenthesis": "(x1",
    "too many arguments": "sin(x1, p1)",
    "no argument": "sin()",
    "an argument too few": "atan2(x1)",
    "a comma": "x1, p1",
}
DOCUMENTS = {
    "a point of 1e999999999": MODEL % "-p1*x1" + f'[point]\nx1 = "{BOMB}"\n',
    "a point of 1e-999999999": MODEL % "-p1*x1" + f'[point]\nx1 = "1e-{"9" * 9}"\n',
    "a point of many digits": MODEL % "-p1*x1" + f'[point]\nx1 = "{"9" * 4000}/{"7" * 4000}"\n',
    "a point of NaN": MODEL % "-p1*x1" + "[point]\nx1 = nan\n",
    "a point of inf": MODEL % "-p1*x1" + "[point]\nx1 = inf\n",
    "a point of 1/0": MODEL % "-p1*x1" + '[point]\nx1 = "1/0"\n',
    "a point at a pole": MODEL % "-p1/x1" + "[point]\nx1 = 0\n",
    "a point at a logarithm's": MODEL % "-p1*log(x1)" + "[point]\nx1 = 0\n",
    "a point of code": MODEL % "-p1*x1" + '[point]\nx1 = "__import__(1)"\n',
    "a known value of itself": MODEL % "-p1*x1" + '[known_initial_values]\nx1 = "x1"\n',
    "a known value at a pole": MODEL % "-p1/x1" + '[known_initial_values]\nx1 = "0"\n',
    "a state twice": MODEL.replace('"x1", "x2"', '"x1", "x1"') % "-p1*x1",
    "a state that is a parameter": MODEL.replace('"p1", "p2"', '"p1", "x2"') % "-p1*x1",
    "a state without an equation": MODEL.replace('"x1", "x2"', '"x1", "x2", "x3"') % "-p1*x1",
    "a state of a function's name": MODEL.replace('"x1", "x2"', '"x1", "x2", "sin"') % "-p1*x1",
    "a state that is a number": MODEL.replace('"x1", "x2"', "1, 2") % "-p1*x1",
    "states of states": MODEL.replace('["x1", "x2"]', '[["x1"], ["x2"]]') % "-p1*x1",
    "states that are one text": MODEL.replace('["x1", "x2"]', '"x1"') % "-p1*x1",
    "a name of 5000 letters": MODEL.replace('"x1", "x2"', f'"x1", "x2", "{"x" * 5000}"') % "-p1*x1",
    "a name with an escape": MODEL.replace('"x1", "x2"', '"x1", "x2", "a\\u001b[2J"') % "-p1*x1",
    "1000 states": "states = [{}]\n[equations]\n{}\n[outputs]\ny = 'x0'\n".format(
        ", ".join(f'"x{k}"' for k in range(1000)), "\n".join(f'x{k} = "x{k}"' for k in range(1000))
    ),
    "400 states in a chain": "states = [{}]\n[equations]\n{}\n[outputs]\ny = 'x0'\n".format(
        ", ".join(f'"x{k}"' for k in range(400)), "\n".join(f'x{k} = "x{(k + 1) % 400}"' for k in range(400))
    ),
    "no output": 'states = ["x1"]\n[equations]\nx1 = "1"\n',
    "no state": 'parameters = ["p1"]\n[outputs]\ny = "p1"\n',
    "only an output": '[outputs]\ny = "1"\n',
    "an equation that is a list": MODEL.replace('"-p2*x2"', "[1, 2]") % "-p1*x1",
    "an equation that is true": MODEL.replace('"-p2*x2"', "true") % "-p1*x1",
    "an equation of NaN": MODEL.replace('"-p2*x2"', "nan") % "-p1*x1",
    "an equation of inf": MODEL.replace('"-p2*x2"', "inf") % "-p1*x1",
    "an equation of a date": MODEL.replace('"-p2*x2"', "2020-01-01") % "-p1*x1",
    "an equation of 5000 digits": MODEL.replace('"-p2*x2"', "9" * 4000) % "-p1*x1",
    "an unknown key": "mode = 3\n" + MODEL % "-p1*x1",
    "a name that is a table": "name = {a = 1}\n" + MODEL % "-p1*x1",
    "a name with an escape for titles": 'name = "\\u001b[2J\\n[bold]x"\n' + MODEL % "-p1*x1",
    "tables nested without end": "a = " + "{b = " * 5000,
    "not TOML": "\x00\x01",
}


def equation_cases() -> Iterator[Case]:
    """Formulas, documents, and what is no file."""
    for what, text in FORMULAS.items():
        yield Case(f"formula: {what}", "gyro", content("m.toml", MODEL % text), OBSERVE)
    for what, text in DOCUMENTS.items():
        yield Case(f"model: {what}", "gyro", content("m.toml", text), OBSERVE)
    for what, build in no_files().items():
        yield Case(f"model is {what}", "gyro", instead("m.toml", build), OBSERVE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them all; exit code 1 where one did what it must not."""
    assert __doc__ is not None
    return campaign("tests.hostile.equations", list(equation_cases()), parser(__doc__).parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
