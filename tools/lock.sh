#!/bin/sh
# Re-compile the four locks from pyproject.toml, keeping the versions that still fit.
#
#     sh tools/lock.sh [--upgrade | --upgrade-package NAME]
#
# Needs uv (UV=/path/to/uv where it is not on the path). The locks hold versions and hashes for
# every platform, and no index: whoever installs chooses that.
set -eu
CDPATH='' cd -- "$(dirname -- "$0")/.."
uv=${UV:-uv}
command -v "$uv" >/dev/null || {
  echo "make lock needs uv: pip install uv in a virtual environment, then UV=/path/to/uv make lock" >&2
  exit 1
}

compile() {
  "$uv" pip compile --quiet --universal --python-version 3.11 --generate-hashes \
    --no-header --no-annotate --no-emit-index-url --no-emit-find-links --no-emit-build-options "$@" >/dev/null
}

compile "$@" --only-binary :all: pyproject.toml --all-extras --group test --group build --group qa -o requirements.lock
compile "$@" --only-binary :all: --group docs --constraints requirements.lock -o requirements-docs.lock
compile "$@" --only-binary :all: --group bench --constraints requirements.lock -o requirements-bench.lock
# FIGAROH needs picos, which has no wheel.
compile "$@" --group peer --constraints requirements.lock -o requirements-peer.lock
if grep -nE '://|^ *--(index|extra|find|trusted|no-|only)| @ ' requirements.lock requirements-docs.lock requirements-bench.lock requirements-peer.lock; then
  echo "the locks must hold names, versions and hashes only" >&2
  exit 1
fi
