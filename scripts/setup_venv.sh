#!/usr/bin/env bash
# Creates .venv with the pinned dependencies and this package in it, once: done again only when a pin or the packaging
# changes. Needs Python 3.11 or 3.12 with the venv module; no compiler, no CUDA toolkit.
#
#   PYTHON=/usr/bin/python3.12 scripts/setup_venv.sh     choose an interpreter
#   VENV=/tmp/venv scripts/setup_venv.sh                 choose a place
set -euo pipefail
cd "$(dirname "$0")/.."

venv=${VENV:-.venv}
log=$venv/setup.log
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

# pip with its output in $log; where it fails, its last errors are shown.
install() {
    attempt "$@" && return
    grep -v '^ *WARNING' "$log" | tail -n 15 >&2
    stop "pip install ${*: -1} failed; its whole output is in $log"
}

# Modules are compiled when they are first imported: nearly half of an installation went into those that nobody imports.
attempt() { "$venv/bin/python" -m pip --disable-pip-version-check install --no-compile --constraint constraints.txt "$@" >>"$log" 2>&1; }

torch_version() { "$venv/bin/python" -c 'from importlib.metadata import version; print(version("torch"))' 2>/dev/null || true; }

# The CPU build, from where pip looks anyhow (a local wheel) or from PyTorch's index of CPU builds; without its dependencies, which
# the last step brings, so that this index is asked for one package only, and no package comes twice at a time. Where neither has it, the plain wheel does the same.
install_torch() {
    local pin
    pin=$(sed -n 's/^torch==\([0-9.]*\).*/\1/p' constraints.txt)
    [[ -n $pin ]] || stop "constraints.txt holds no 'torch==VERSION' line; restore it"
    case $(torch_version) in "$pin" | "$pin"+*) return ;; esac
    if wants_cpu_torch; then
        attempt --no-deps --retries 1 "torch==$pin+cpu" && return
        attempt --no-deps --retries 1 --timeout 10 --index-url "$cpu_index" "torch==$pin+cpu" && return
        echo "setup: no CPU build of torch $pin can be reached for this Python; the plain one comes in its place, 6.6 GB with CUDA libraries"
    fi
    install --no-deps "torch==$pin"
}

# A CPU build that was followed by CUDA libraries means that an index served something else in its place.
refuse_cuda_wheels() {
    [[ $(torch_version) == *+cpu ]] || return 0
    local found
    found=$("$venv/bin/python" -m pip list --format=freeze 2>/dev/null | grep -i '^nvidia-' | head -1 || true)
    [[ -z $found ]] || stop "torch is a CPU build, yet $found came along; remove $venv and check which package index serves torch"
}

# Every third pin, from the first, second or third. What fails here is tried again, and said, with the package itself.
install_share() {
    local pins
    mapfile -t pins < <(grep -o '^[[:alnum:]][^ ;]*==[^ ;]*' constraints.txt | grep -v '^torch==' | sed -n "$1~3p")
    attempt --no-deps "${pins[@]}" || true
}

# Side by side: to ask for each of 200 packages takes as long as to unpack them.
install_pins() {
    local beside
    install_torch &
    beside=$!
    for share in 1 2 3; do install_share "$share" & done
    wait "$beside" || exit 2
    wait
}

main() {
    local stamp=$venv/.set-up
    [[ -f $stamp && $(<"$stamp") == "$(fingerprint)" ]] && return
    [[ -x $venv/bin/python ]] || make_venv
    rm -f "$stamp"
    echo "setup: installing pinned dependencies (a minute or two)"
    : >"$log"
    install_pins
    install --editable '.[ros,rerun,models,capture,ray,dev]'
    refuse_cuda_wheels
    fingerprint >"$stamp"
    echo "setup: done"
}

main
