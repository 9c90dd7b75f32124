#!/bin/sh
# Creates .venv with all that demo, tests and checks need. It installs system packages only where Python packages are
# not enough, and only as root or with a sudo that needs no password.
set -eu
cd "$(dirname "$0")/../.."
PYTHON=${PYTHON:-python3}

may_install() {
    command -v apt-get >/dev/null 2>&1 || return 1
    [ "$(id -u)" = 0 ] || sudo -n true 2>/dev/null
}

apt_install() {
    may_install || return 1
    as_root=""
    [ "$(id -u)" = 0 ] || as_root="sudo -n"
    echo "setup: installing $* (Debian packages)"
    export DEBIAN_FRONTEND=noninteractive
    $as_root timeout 60 apt-get install -y -qq --no-install-recommends "$@" >/dev/null 2>&1 && return 0
    $as_root timeout 90 apt-get update -qq >/dev/null 2>&1 || return 1
    $as_root timeout 60 apt-get install -y -qq --no-install-recommends "$@" >/dev/null 2>&1
}

if ! command -v "$PYTHON" >/dev/null 2>&1; then
    apt_install python3 python3-venv || { echo "setup: no $PYTHON found: install Python 3.11 or newer" >&2; exit 1; }
fi
if ! "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "setup: $PYTHON is $("$PYTHON" -V 2>&1), 3.11 or newer is needed: make PYTHON=python3.12 ..." >&2
    exit 1
fi
if [ ! -x .venv/bin/python ]; then
    echo "setup: virtual environment .venv"
    if ! "$PYTHON" -m venv .venv >/dev/null 2>&1; then
        rm -rf .venv
        apt_install python3-venv || { echo "setup: can't make a virtual environment: install python3-venv" >&2; exit 1; }
        "$PYTHON" -m venv .venv
    fi
fi
echo "setup: Python packages (a minute or so; the physics engine is 100 MB)"
.venv/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'

if ! command -v dot >/dev/null 2>&1 && ! .venv/bin/python -c 'import pygraphviz' 2>/dev/null; then
    apt_install graphviz || echo "setup: no graphviz found: task trees will be drawn as text"
fi
if ! command -v chromium >/dev/null 2>&1 && ! command -v chromium-browser >/dev/null 2>&1 \
    && ! command -v google-chrome >/dev/null 2>&1; then
    apt_install chromium || echo "setup: no Chromium found: the tests of the viewer's page will be skipped"
fi
echo "setup: done"
