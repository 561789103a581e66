#!/bin/sh
# Makes .venv and installs the package in it: .ci/environment.sh [extra,extra]; called by the Makefile at every target.
# Returns at once when the same extras of the same pyproject.toml are installed in this folder already.
# CI sets SPINFILTERS_CONSTRAINTS to a file of versions for pip; without it everybody gets the newest that pyproject.toml admits.
set -eu
cd "$(dirname "$0")/.."

extras=${1:-}
constraints=${SPINFILTERS_CONSTRAINTS:-}
unfinished=.venv/.unfinished # there while something is being installed: an interrupted .venv is never trusted
export PIP_USER=0 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INPUT=1

main() {
  wanted="$(cksum <pyproject.toml) in $PWD${constraints:+ with $(cksum <"$constraints")}"
  if installed; then return; fi
  if [ -e "$unfinished" ] || ! usable .venv/bin/python; then rm -rf .venv; fi
  if [ ! -d .venv ]; then create; fi
  say "installing spinfilters${extras:+ [$extras]} into .venv (the first time: some hundred MB, a minute or two)"
  : >"$unfinished"
  if [ "$constraints" = .ci/constraints.txt ]; then install_without_missing; else
    install ${constraints:+--constraint "$constraints"} || fail_to_install
  fi
  for stamp in $(stamps); do printf '%s\n' "$wanted" >"$stamp"; done
  rm "$unfinished"
}

install() { .venv/bin/python -m pip install --quiet --editable ".${extras:+[$extras]}" "$@" </dev/null; }

# One version of a package need not be there for every Python and machine (of the smallest versions that is what is tested):
# a pin of a package that pip does not find is dropped, all others stay. Where pip names none, no pin is kept.
install_without_missing() {
  pins=.venv/.constraints
  cat "$constraints" >"$pins"
  until install --constraint "$pins" 2>"$pins.log"; do
    cat "$pins.log" >&2
    missing=$(sed -n 's/.*No matching distribution found for \([A-Za-z0-9._-]*\).*/\1/p' "$pins.log" | sed -n 1p)
    name=$(printf '%s' "$missing" | sed 's/[-_.]/[-_.]/g')
    grep -iv "^$name==" "$pins" >"$pins.left" || : # none is left
    if [ -z "$missing" ] || cmp -s "$pins" "$pins.left"; then
      say "the versions of $constraints cannot be installed together here: taking the newest"
      install || fail_to_install
      return
    fi
    say "the version of $missing in $constraints cannot be installed here: taking the newest that fits"
    mv "$pins.left" "$pins"
  done
  cat "$pins.log" >&2
}

fail_to_install() {
  fail "the installation failed as shown above; check the network and the disk, then repeat the command"
}

# A file for each extra, which says for what it was installed.
stamps() {
  for extra in $(printf '%s' "${extras:-nothing}" | tr , ' '); do
    if [ "$extra" = nothing ]; then echo .venv/.installed; else echo ".venv/.installed-$extra"; fi
  done
}

installed() {
  for stamp in $(stamps); do
    if [ ! -f "$stamp" ] || [ "$(cat "$stamp")" != "$wanted" ]; then return 1; fi
  done
  [ ! -e "$unfinished" ] && version .venv/bin/python >/dev/null
}

usable() { version "$1" >/dev/null && "$1" -m pip --version >/dev/null 2>&1; }

create() {
  python=$(suitable_python)
  version=$(version "$python")
  say "creating .venv with Python $version"
  mkdir .venv
  : >"$unfinished"
  if "$python" -m venv .venv >/dev/null 2>&1; then return; fi
  # Debian's python3 comes without ensurepip: a pip of its own can still fill the environment from outside
  if "$python" -m venv --without-pip .venv >/dev/null 2>&1 &&
    "$python" -m pip --python .venv/bin/python install --quiet pip >/dev/null 2>&1; then return; fi
  say "this Python cannot make environments: installing the package python$version-venv"
  if as_root apt-get install -y -qq "python$version-venv" || { as_root apt-get update -qq &&
    as_root apt-get install -y -qq "python$version-venv"; } && "$python" -m venv .venv; then return; fi
  rm -rf .venv
  fail "Python $version cannot make environments; type 'sudo apt-get install -y python$version-venv', then repeat the command"
}

as_root() {
  command -v apt-get >/dev/null || return 1
  if [ "$(id -u)" = 0 ]; then
    DEBIAN_FRONTEND=noninteractive "$@" </dev/null >/dev/null 2>&1
  else
    sudo -n env DEBIAN_FRONTEND=noninteractive "$@" </dev/null >/dev/null 2>&1
  fi
}

# The first of $PYTHON, python3, python3.13, ... that runs and that pyproject.toml admits; a bare Debian has none.
suitable_python() {
  seen=
  for candidate in ${PYTHON:-} python3 python3.13 python3.12 python3.11; do
    if version "$candidate" >/dev/null; then
      echo "$candidate"
      return
    fi
    seen="$seen${seen:+, }$(found "$candidate")"
  done
  case $seen in
    *" is "[0-9]*) ;; # of another version: which to install is not for this script to say
    *)
      say "there is no Python: installing the packages python3 and python3-venv"
      if as_root apt-get update -qq && as_root apt-get install -y -qq python3 python3-venv &&
        version python3 >/dev/null; then
        echo python3
        return
      fi
      ;;
  esac
  fail "spinfilters needs Python 3.11, 3.12 or 3.13, but here $seen; install one ('sudo apt-get install -y python3 python3-venv'), then repeat the command"
}

# Prints 3.x, and fails for a version that pyproject.toml does not admit or a Python that does not run.
version() {
  "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2]); sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null
}

found() {
  release=$("$1" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null) || release=
  echo "$1 is ${release:-absent}"
}

say() { printf '%s\n' "$*" >&2; }

fail() {
  say "$*"
  exit 1
}

main
