#!/bin/sh
# The nodes of a cluster of one machine: runs tasks one after the other, and keeps how they stand in $FAKE/JOB/SHARD.
# usage: tasks.sh SHARDS VARIABLE FOLDER SCRIPT ROUND; prints the number of the job
set -u
shards=$1 variable=$2 folder=$3 script=$4 round=$5
job=1
while ! mkdir "$FAKE/$job" 2>/dev/null; do job=$((job + 1)); done
list=
for range in $(echo "$shards" | tr , ' '); do list="$list $(seq "${range%-*}" "${range#*-}")"; done
for shard in $list; do echo PENDING > "$FAKE/$job/$shard"; done
state() {
    echo "$2" > "$FAKE/$job/$1.new"
    mv "$FAKE/$job/$1.new" "$FAKE/$job/$1"
}
(
    cd "$folder" || exit 1
    for shard in $list; do
        while [ -e "$FAKE/hold" ] && [ ! -e "$FAKE/$job/cancel" ]; do sleep 0.05; done
        if [ -e "$FAKE/$job/cancel" ]; then
            state "$shard" CANCELLED
            continue
        fi
        state "$shard" RUNNING
        env "$variable=$shard" sh "$script" "$round" &
        task=$!
        # What `kill` names is killed as soon as it has begun, once.
        if [ -e "$FAKE/kill-$shard" ]; then
            rm "$FAKE/kill-$shard"
            kill -9 "$task"
        fi
        # What `always-kill` names is killed whenever it begins.
        [ -e "$FAKE/always-kill-$shard" ] && kill -9 "$task"
        if wait "$task"; then state "$shard" COMPLETED; else state "$shard" FAILED; fi
    done
) </dev/null >/dev/null 2>&1 &
echo "$job"
