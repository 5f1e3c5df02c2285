#!/usr/bin/env bash
# A campaign in containers, each with a part of the runs: here one after the other on this machine; put
# the command in the loop into jobs of a scheduler to have them side by side.
#
#     podman build --tag sidehill --file examples/campaign/Containerfile .
#     examples/campaign/containers.sh config/campaigns/default.yaml results
#
# RUNS, SHARE (runs a container) and ENGINE (podman or docker) may be set in the environment. The
# campaign is one of the image; the folder is mounted.
set -euo pipefail

campaign=${1:?the campaign is missing: containers.sh CAMPAIGN.yaml FOLDER}
folder=${2:?the folder for the results is missing: containers.sh CAMPAIGN.yaml FOLDER}
runs=${RUNS:-1000}
share=${SHARE:-250}
engine=${ENGINE:-podman}

mkdir -p "$folder"
folder=$(realpath "$folder")
for ((from = 0; from < runs; from += share)); do
    to=$((from + share < runs ? from + share : runs))
    "$engine" run --rm --volume "$folder:/results" sidehill \
        campaign "$campaign" --range "$from..$to" --out "$(printf '/results/part_%08d.csv' "$from")"
done
"$engine" run --rm --volume "$folder:/results" --entrypoint sh sidehill \
    -c 'sidehill campaign --merge /results/part_*.csv --out /results/all.csv'
