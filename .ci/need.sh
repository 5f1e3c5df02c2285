# Sourced by the scripts beside it: installs what a job needs on Debian or Ubuntu.

# in_turn COMMAND [ARGUMENT...]: jobs beside each other install one after the other.
in_turn() {
    (
        flock 9
        "$@" 9>&-
    ) 9>"${TMPDIR:-/tmp}/sidehill-ci-install"
}

# apt_install PACKAGE...: installs Debian packages.
apt_install() {
    if [ "$(id -u)" -eq 0 ]; then as_root=; else as_root=sudo; fi
    in_turn $as_root apt-get update
    in_turn $as_root apt-get install --yes --no-install-recommends "$@"
}

# need COMMAND PACKAGE: installs the Debian package that has the command.
need() {
    command -v "$1" >/dev/null || apt_install "$2"
}

# build_programs [CARGO]: builds both programs into target/debug/, by another command than cargo where one is named.
# With the features of the whole workspace nothing that the tests have compiled is compiled again.
build_programs() {
    "${1:-cargo}" build --workspace --locked
}

# need_library LIBRARY PACKAGE...: installs the Debian packages that have the shared library.
need_library() {
    ldconfig -p | grep -q "$1" && return
    shift
    apt_install "$@"
}

# need_component COMMAND COMPONENT: installs the toolchain component that has `cargo COMMAND`.
need_component() {
    cargo "$1" --version >/dev/null 2>&1 || in_turn rustup component add "$2"
}

# need_target TRIPLE: installs Rust's library of a platform; fails where it cannot be had.
need_target() {
    [ -d "$(rustc --print target-libdir --target "$1")" ] || in_turn rustup target add "$1"
}

# need_python MODULES PACKAGE...: installs the Python packages where one of the modules is missing.
need_python() {
    need python3 python3
    modules=$1
    shift
    python3 -c "import $modules" 2>/dev/null && return
    python3 -m pip --version >/dev/null 2>&1 || need pip3 python3-pip
    # Debian and Ubuntu guard the system's packages; a CI machine has nothing to guard.
    in_turn env PIP_BREAK_SYSTEM_PACKAGES=1 python3 -m pip install --quiet "$@"
}
