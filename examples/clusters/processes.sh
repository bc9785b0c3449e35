#!/usr/bin/env bash
# Eight shards as bare processes on one store, two at a time: the same as one process. KILLS=20 kills them meanwhile.
# usage: TURBID=turbid [KILLS=20] bash processes.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
reference
out=processes
shard() {
    # A shard that was killed is run again, as a requeueing engine would.
    until "$TURBID" run sweep.yaml "${set_to[@]}" --outputs "$out" -j 1 --shard "$1/8" > "$out-$1.log" 2>&1; do :; done
}
kill_shard() {
    local shards
    mapfile -t shards < <(pgrep -f "^$TURBID run sweep.yaml.*--outputs $out -j 1 --shard" || true)
    [ "${#shards[@]}" -gt 0 ] && kill -9 "${shards[RANDOM % ${#shards[@]}]}" 2>/dev/null && echo "kill -9: a shard"
}
mkdir -p "$out"
(
    for first in 1 2; do
        (for shard in $(seq "$first" 2 8); do shard "$shard"; done) &
    done
    wait
) &
command=$!
kills "$command" kill_shard
wait "$command"
"$TURBID" run sweep.yaml "${set_to[@]}" --outputs "$out" --json | tail -n 1
compare "$out"
