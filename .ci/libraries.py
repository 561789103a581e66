"""Build the compiled libraries of a wheel: ``python .ci/libraries.py [KIND ...]``, before ``pip wheel .``.

Runs the estimators on simulated recordings with a compiler that notes what it compiles. Then compiles each text for every
instruction set of the architecture. Needs the package's dependencies, those of its extra ``campaign``, and GCC or clang.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
KINDS = ("stereo-tracks", "mono-tracks", "gyro", "attitude", "pose")
BATCHED = ("attitude", "pose")  # kinds whose runs a campaign makes side by side
STUDY = """[study]
name = "libraries"
description = "Runs side by side."
seeds = 8
initialisation = "drawn"
bound = "none"
[factors]
estimator = ["mekf"]
[motion.base]
epochs = 20
[sensor.base]
kind = "{kind}"
"""
LANES = {"x86-64-v4": 8}  # numbers in a vector where not 4
WRAPPER = """#!/bin/sh
# notes flags and text, then compiles
place=$(mktemp -d "{noted}/XXXXXXXX")
for word; do
  case "$word" in
    */source.c) cp "$word" "$place/source.c" ;;
    -o | *.so | -lm) ;;
    *) printf '%s\\n' "$word" >> "$place/flags" ;;
  esac
done
exec "{compiler}" "$@"
"""


def main() -> int:
    """Build all libraries into the package."""
    sys.path.insert(0, str(ROOT))
    from spinfilters.core.shipped_libraries import FOLDER, LEVELS, NATIVE, family, shipped_name

    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is None:
        print("there is no C compiler", file=sys.stderr)
        return 1
    levels = [level for level in LEVELS if family(level) == family(platform.machine())]
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir()
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        for lanes in sorted({LANES.get(level, 4) for level in levels}):
            noted = scratch / f"noted-{lanes}"
            noted.mkdir()
            wrapper = scratch / f"cc-{lanes}"
            wrapper.write_text(WRAPPER.format(noted=noted, compiler=compiler))
            wrapper.chmod(0o700)
            note_texts(scratch / f"cache-{lanes}", wrapper, lanes, sys.argv[1:])
            for place in sorted(noted.iterdir()):
                text = (place / "source.c").read_text()
                flags = (place / "flags").read_text().split()
                for level in [each for each in levels if LANES.get(each, 4) == lanes]:
                    library = FOLDER / shipped_name(text, flags, level)
                    wanted = [f"-march={level}" if flag == NATIVE else flag for flag in flags]
                    if not library.exists():
                        command = [compiler, *wanted, "-s", "-o", library, place / "source.c", "-lm"]
                        subprocess.run(command, check=True)
    files = list(FOLDER.iterdir())
    print(f"{FOLDER}: {len(files)} libraries, {sum(each.stat().st_size for each in files) / 1e6:.1f} MB")
    return 0


def note_texts(cache: Path, compiler: Path, lanes: int, kinds: list[str]) -> None:
    """Run the estimators on a recording of each of the kinds, or of all and on the bundled example, compiling all anew.

    Runs that a campaign makes side by side have compiled code of their own.
    """
    environment = {
        **os.environ,
        "CC": str(compiler),
        "SPINFILTERS_CACHE": str(cache),
        "SPINFILTERS_COMPILE": "here",  # also what a short run would interpret
        "SPINFILTERS_LANES": str(lanes),
        "PYTHONPATH": str(ROOT),
    }
    command = [sys.executable, "-m", "spinfilters"]
    with tempfile.TemporaryDirectory() as name:
        quiet = ["-q", "--no-figures", "-o", f"{name}/run"]
        runs = [] if kinds else [["compare", *quiet], ["compare", "--known-map", *quiet]]
        for kind in kinds or KINDS:
            recording = f"{name}/{kind}"
            runs += [["simulate", "-o", recording, "--kind", kind], ["compare", recording, *quiet]]
            if kind in BATCHED:
                study = Path(f"{name}/{kind}.toml")
                study.write_text(STUDY.format(kind=kind))
                runs += [["campaign", str(study), "-o", f"{name}/{kind}-rows", "--batch"]]
        for run in runs:
            subprocess.run([*command, *run], env=environment, stdout=subprocess.DEVNULL, check=True)


if __name__ == "__main__":
    sys.exit(main())
