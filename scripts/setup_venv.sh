#!/usr/bin/env bash
# Creates .venv with the pinned dependencies and this package in it, once: done again only when a pin or the packaging
# changes. Needs Python 3.11 or 3.12 with the venv module; no compiler, no CUDA toolkit.
#
#   PYTHON=/usr/bin/python3.12 scripts/setup_venv.sh     choose an interpreter
#   VENV=/tmp/venv scripts/setup_venv.sh                 choose a place
set -euo pipefail
cd "$(dirname "$0")/.."

venv=${VENV:-.venv}
cpu_index=https://download.pytorch.org/whl/cpu

stop() {
    echo "setup: $*" >&2
    exit 2
}

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3.11 python3.12 python3}; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    stop "no Python 3.11 or 3.12 found (tried ${PYTHON:-python3.11 python3.12 python3}); install one, or name one with PYTHON=/path/to/python"
}

# A machine counts as having an NVIDIA GPU when its driver is loaded.
has_gpu() { [[ -e /proc/driver/nvidia/version ]] || { command -v nvidia-smi >/dev/null && nvidia-smi -L >/dev/null 2>&1; }; }

wants_cpu_torch() { [[ $(uname -sm) == "Linux x86_64" ]] && ! has_gpu; }

# What the stamp must equal for the venv to be up to date.
fingerprint() {
    cat constraints.txt setup.py setup.cfg pyproject.toml package.xml scripts/setup_venv.sh 2>/dev/null | cksum
    wants_cpu_torch && echo cpu || echo plain
    pwd
}

make_venv() {
    local python
    python=$(find_python)
    "$python" -c 'import ensurepip, venv' 2>/dev/null ||
        stop "$python has no venv module; install it, on Debian or Ubuntu with: sudo apt install $("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')"
    echo "setup: creating $venv with $("$python" --version)"
    "$python" -m venv "$venv" || stop "$python -m venv $venv failed; see above"
}

install() {
    local pip=("$venv/bin/python" -m pip --disable-pip-version-check install --quiet --constraint constraints.txt)
    local torch
    torch=$(sed -n 's/^torch==\([0-9.]*\).*/\1/p' constraints.txt)
    [[ -n $torch ]] || stop "constraints.txt holds no 'torch==VERSION' line; restore it"
    echo "setup: installing pinned dependencies (a minute or two)"
    if wants_cpu_torch; then
        # the plain wheel would bring gigabytes of CUDA libraries; PyTorch documents this index for its CPU builds.
        # Without its dependencies, which the next step brings: that index is asked for one package only.
        "${pip[@]}" --no-deps "torch==$torch+cpu" --extra-index-url "$cpu_index"
    else
        "${pip[@]}" "torch==$torch"
    fi
    "${pip[@]}" --editable '.[ros,dev,capture]'
}

refuse_cuda_wheels() {
    wants_cpu_torch || return 0
    local found
    found=$("$venv/bin/python" -m pip list --format=freeze 2>/dev/null | grep -i '^nvidia-' | head -1 || true)
    [[ -z $found ]] || stop "this machine has no NVIDIA GPU, yet $found came along; remove $venv and check which package index serves torch"
}

main() {
    local stamp=$venv/.set-up
    [[ -f $stamp && $(<"$stamp") == "$(fingerprint)" ]] && return
    [[ -x $venv/bin/python ]] || make_venv
    rm -f "$stamp"
    install
    refuse_cuda_wheels
    fingerprint >"$stamp"
    echo "setup: done"
}

main
