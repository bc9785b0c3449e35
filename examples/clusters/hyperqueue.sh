#!/usr/bin/env bash
# Eight shards on HyperQueue: a server and two workers on this machine, from the Python package in an environment of its own.
# usage: TURBID=turbid [KILLS=20] [PIP='hyperqueue==0.27.0'] bash hyperqueue.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
[ -x python/bin/python ] || { python3 -m venv python && python/bin/pip install --quiet ${PIP:-hyperqueue==0.27.0}; }
export HQ_SERVER_DIR=$WORK/server TURBID_PYTHON=$WORK/python/bin/python
mkdir -p "$HQ_SERVER_DIR"
cluster() { # cluster NAME ARGUMENTS..: a process of its own, once it is ready
    local name=$1
    shift
    : > "$name.log"
    "$TURBID_PYTHON" "$here/hyperqueue_cluster.py" "$@" >> "$name.log" 2>&1 &
    echo $! > "$name.pid"
    disown
    for _ in $(seq 100); do
        grep -q '^ready' "$name.log" && return
        sleep 0.1
    done
    echo "$name did not start:" && cat "$name.log" && exit 1
}
worker() {
    rm -rf "own-$1" && mkdir "own-$1"
    cluster "worker-$1" worker "$HQ_SERVER_DIR" "own-$1"
}
trap 'end worker-*.pid server.pid' EXIT
cluster server server "$HQ_SERVER_DIR"
worker 1
worker 2
kill_worker() {
    local worker=$((RANDOM % 2 + 1))
    echo "kill -9: worker $worker"
    kill -9 "$(cat "worker-$worker.pid")" 2>/dev/null
    worker "$worker"
}
kill_server() {
    echo "kill -9: server"
    kill -9 "$(cat server.pid)" 2>/dev/null
    end worker-*.pid
    cluster server server "$HQ_SERVER_DIR"
    worker 1
    worker 2
}
reference
echo "eight shards on HyperQueue:"
"$TURBID" submit sweep.yaml "${set_to[@]}" --outputs hyperqueue --engine hq --shards 8 --task-seconds 0 --follow --retries 99 --json \
    > hyperqueue.jsonl 2> hyperqueue.err &
command=$!
kills "$command" kill_task kill_task kill_worker kill_server
wait "$command" || { tail hyperqueue.jsonl hyperqueue.err; exit 1; }
tail -n 1 hyperqueue.jsonl
compare hyperqueue
