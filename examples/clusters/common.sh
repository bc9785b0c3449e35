# What the scripts of this folder share. Each runs sweep.yaml in shards and compares with one process; KILLS=20 kills as
# often, meanwhile, at random moments (of SEED): tasks, workers, servers. TURBID is the program; WORK the folder of all files.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
TURBID=$(command -v "${TURBID:-turbid}")
WORK=${WORK:-$(mktemp -d)}
mkdir -p "$WORK"
RANDOM=${SEED:-1}
cp "$here/sweep.yaml" "$WORK/sweep.yaml"
cd "$WORK"
set_to=(--set "vars.samples=${SAMPLES:-2000}" --set "vars.points=${POINTS:-64}" --set "vars.from=${FROM:-0.005}")

# Ends processes that were started here, by the ids in files of this folder.
end() {
    for file in "$@"; do
        [ -s "$file" ] || continue
        kill "$(cat "$file")" 2>/dev/null || true
        rm -f "$file"
    done
}

digests() { "$TURBID" cache digests --outputs "$1"; }

reference() {
    [ -s one.digests ] && return
    echo "one process:"
    "$TURBID" run sweep.yaml "${set_to[@]}" --outputs one --json > one.jsonl
    tail -n 1 one.jsonl
    digests one > one.digests
}

# compare OUTPUTS: the same digests; every result made once, and what was begun in vain.
compare() {
    digests "$1" > "$1.digests"
    cmp one.digests "$1.digests"
    cat "$1"/runs/*/events.jsonl > "$1.events"
    local ran begun found twice
    ran=$(grep -c '"event":"ran"' "$1.events")
    begun=$(grep -c '"event":"started"' "$1.events")
    found=$(grep -c '"event":"found"' "$1.events" || true)
    twice=$(sed -n '/"event":"ran"/s/.*"instance":"\([^"]*\)".*/\1/p' "$1.events" | sort | uniq -d | wc -l)
    echo "$1: the digests of one process ($(wc -l < one.digests) blobs); $ran instances ran, $twice of them twice;" \
        "$((begun - ran - found)) were begun and lost"
}

# kills COMMAND_PID KILL..: while the command is at work, one of the given functions at a time, KILLS times.
kills() {
    local command=$1 killed=0
    shift
    while [ "$killed" -lt "${KILLS:-0}" ] && kill -0 "$command" 2>/dev/null; do
        sleep "$((RANDOM % 2)).$((RANDOM % 10))"
        "${@:RANDOM % $# + 1:1}" && killed=$((killed + 1))
    done
    echo "$killed kills"
}

# A task that is at work, any one.
kill_task() {
    local tasks
    mapfile -t tasks < <(pgrep -f "^$TURBID task $WORK/" || true)
    [ "${#tasks[@]}" -gt 0 ] || return 1
    local task=${tasks[RANDOM % ${#tasks[@]}]}
    echo "kill -9: task $(tr '\0' ' ' < "/proc/$task/cmdline" 2>/dev/null | sed 's/.*job.json //')" && kill -9 "$task" 2>/dev/null
}
