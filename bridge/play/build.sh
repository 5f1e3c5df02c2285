#!/bin/sh
# Builds the page of `sidehill play`, one file that needs no network: FOLDER/index.html, by default in target/play.
#
#     bridge/play/build.sh [FOLDER]
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
folder=${1:-$root/target/play}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$root/target}"

cd "$root/bridge/play"
target=wasm32-unknown-unknown
if ! [ -d "$(rustc --print target-libdir --target $target)" ]; then
    echo "the Rust target $target is missing, only the page of \`sidehill play\` needs it: rustup target add $target" >&2
    exit 3
fi
cargo build --locked --quiet --profile page --target $target --package sidehill-play
cargo run --locked --quiet --package sidehill-play-site -- \
    "$CARGO_TARGET_DIR/$target/page/sidehill_play.wasm" "$folder"
