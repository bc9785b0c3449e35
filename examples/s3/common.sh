# What the scripts of this folder share. Each starts a service of S3 on 127.0.0.1 and checks against it what docs/store.md
# promises of a store in S3. TURBID is the program (with the feature `s3`); KILLS of pushes and pulls come at random moments
# (of SEED). All files are in a temporary folder, which goes at the end with all that was started; KEEP=1 leaves it.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
TURBID=$(command -v "${TURBID:-turbid}") || { echo "no turbid is in PATH: name it with TURBID=.." >&2; exit 1; }
KILLS=${KILLS:-20}
RANDOM=${SEED:-1}
WORK=$(mktemp -d)
cd "$WORK"
# Nothing of the user's own settings counts.
unset "${!AWS_@}" "${!TURBID_S@}" TURBID_OUTPUTS
export AWS_CONFIG_FILE=$WORK/none AWS_SHARED_CREDENTIALS_FILE=$WORK/none
started=()

# begin NAME COMMAND..: starts it in the background; what it says goes to NAME.out.
begin() {
    local name=$1
    shift
    "$@" > "$name.out" 2>&1 &
    started+=("$!")
}

# Ends what was started, by its ids, the last first, and removes all files; also after Ctrl-C.
finish() {
    trap '' INT TERM
    local n pid
    for ((n = ${#started[@]} - 1; n >= 0; n--)); do
        pid=${started[n]}
        kill "$pid" 2> /dev/null || continue
        for _ in $(seq 30); do
            kill -0 "$pid" 2> /dev/null || break
            sleep 0.1
        done
        kill -9 "$pid" 2> /dev/null || true
        wait "$pid" 2> /dev/null || true
    done
    if [ "${KEEP:-0}" = 1 ]; then echo "files: $WORK"; else rm -rf "$WORK"; fi
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

fail() {
    echo "failed: $*" >&2
    exit 1
}

# python PACKAGE..: a virtual environment with these packages.
python() {
    python3 -m venv venv > venv.log 2>&1 || fail "python3 cannot make a virtual environment (on Debian: apt-get install python3-venv): $(tail -n 1 venv.log)"
    venv/bin/pip install --quiet --disable-pip-version-check "$@" > venv.log 2>&1 || fail "pip cannot install $*: $(tail -n 1 venv.log)"
}

client() { venv/bin/python "$here/client.py" "$@"; }

free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'; }

# answers URL: waits until something answers there.
answers() {
    for _ in $(seq 600); do
        python3 -c 'import sys, urllib.request; urllib.request.urlopen(sys.argv[1], timeout=5)' "$1" 2> /dev/null && return
        sleep 0.2
    done
    fail "nothing answers at $1: $(tail -n 3 ./*.out)"
}

turbid() { "$TURBID" "$@"; }
digests() { turbid cache digests --outputs "$1"; }
cache() { turbid cache "$1" --outputs "$2" --store "$store"; }

# is_up_to_date OUTPUTS [--set ..]: everything that the plan names is a hit.
is_up_to_date() {
    local outputs=$1
    shift
    turbid plan shared.yaml --outputs "$outputs" --json "$@" > plan.json
    grep -q '"state":"hit"' plan.json || fail "nothing is a hit in $outputs"
    if grep -o '"state":"[^"]*"' plan.json | grep -v '"hit"'; then fail "not all is a hit in $outputs"; fi
}

# is_whole OUTPUTS: everything is a hit, is sound, and has the digests of the machine that ran it.
is_whole() {
    is_up_to_date "$1"
    turbid cache verify --outputs "$1" > verify.log || fail "$1 is not sound: $(cat verify.log)"
    digests "$1" | cmp - a.digests || fail "the digests of $1 are others"
}

# refused WORDS COMMAND..: it ends with 1, and its message has the bucket and these words.
refused() {
    local words=$1 status=0 word
    shift
    "$@" > refused.log 2>&1 || status=$?
    [ "$status" = 1 ] || fail "exit code $status, not 1: $(cat refused.log)"
    for word in "s3://" $words; do
        grep -qF -- "$word" refused.log || fail "the message does not name $word: $(cat refused.log)"
    done
    echo "   $(cat refused.log)"
}

now_ms() { date +%s%3N; }

# cut MS COMMAND..: kills it at a random moment of so many ms; counts it if it was still at work.
cut() {
    local status=0 pid ms=$((RANDOM * $1 / 32768))
    shift
    "$@" > cut.log 2>&1 &
    pid=$!
    started+=("$pid")
    sleep "$((ms / 1000)).$(printf %03d $((ms % 1000)))"
    kill -9 "$pid" 2> /dev/null || true
    { wait "$pid" || status=$?; } 2> /dev/null
    unset 'started[-1]'
    case $status in
        137) killed=$((killed + 1)) ;;
        0) ;;
        *) fail "a transfer that was to be killed failed: $(cat cut.log)" ;;
    esac
}

# check BUCKET: the whole contract, in an empty bucket that the keys of the environment may use.
check() {
    local bucket=$1 began push_ms pull_ms count killed=0 rounds=0
    export AWS_REGION=us-east-1
    cp "$here/shared.yaml" .

    echo "machine a runs the pipeline, and pushes; the prefix has what must be escaped in a signature:"
    turbid run shared.yaml --outputs a --json > run.jsonl 2> run.err || fail "$(cat run.err)"
    digests a > a.digests
    store="s3://$bucket/sfdi 2026/ü+(a)=b&c~"
    cache push a
    began=$(now_ms)
    store=s3://$bucket/plain
    cache push a
    push_ms=$(($(now_ms) - began))

    echo "machine b pulls:"
    for store in "s3://$bucket/sfdi 2026/ü+(a)=b&c~" "s3://$bucket/plain"; do
        rm -rf b
        began=$(now_ms)
        cache pull b
        pull_ms=$(($(now_ms) - began))
        is_whole b
    done
    echo "   all is a hit there; the same $(wc -l < a.digests) digests"

    echo "what is there is not sent again, nor pulled again:"
    cache push a | tee again.log
    grep -q '^nothing was to be pushed' again.log || fail "a second push sent something"
    grep -q ' 0 bytes sent' again.log || fail "a second push sent bytes"
    cache pull b | tee again.log
    grep -q '^nothing was to be pulled' again.log || fail "a second pull brought something"

    echo "lists of several pages (1100 more objects before those of the store):"
    client clutter "$bucket" plain/packs 1100
    cache push a | tee again.log
    grep -q '^4 requests, 0 bytes sent' again.log || fail "not four pages of lists"
    rm -rf b
    cache pull b > /dev/null
    is_whole b

    echo "machine c runs with the store behind it, and what it makes comes to a:"
    turbid run shared.yaml --outputs c --store "$store" --json > run.jsonl 2> run.err || fail "$(cat run.err)"
    tail -n 1 run.jsonl
    if grep -q '"event":"ran"' run.jsonl; then fail "c ran what was in the bucket"; fi
    turbid run shared.yaml --set vars.points=3 --outputs c --store "$store" --json > run.jsonl 2> run.err || fail "$(cat run.err)"
    count=$(grep -c '"event":"ran"' run.jsonl)
    [ "$count" = 3 ] || fail "c ran $count instances, and three are new"
    cp -r a d
    turbid cache pull shared.yaml --set vars.points=3 --outputs d --store "$store"
    is_up_to_date d --set vars.points=3

    echo "what is refused ends with 1, and is named:"
    refused "$bucket 403" env AWS_SECRET_ACCESS_KEY=wrong "$TURBID" cache push --outputs a --store "$store"
    refused "$bucket 403" env AWS_SECRET_ACCESS_KEY=wrong "$TURBID" cache pull --outputs e --store "$store"
    refused "$bucket 403" env AWS_ACCESS_KEY_ID=AKIANOBODY "$TURBID" cache push --outputs a --store "$store"
    refused "$bucket-missing 404" "$TURBID" cache push --outputs a --store "s3://$bucket-missing/plain"
    refused "$bucket-missing 404" "$TURBID" cache pull --outputs e --store "s3://$bucket-missing/plain"
    if AWS_REGION=eu-north-1 turbid cache push --outputs a --store "$store" > region.log 2>&1; then
        echo "   (this service takes requests that were signed for any region)"
    else
        refused "$bucket region" env AWS_REGION=eu-north-1 "$TURBID" cache push --outputs a --store "$store"
    fi

    echo "$KILLS kills of pushes and pulls, at random moments:"
    while [ "$killed" -lt "$KILLS" ]; do
        rounds=$((rounds + 1))
        [ "$rounds" -le "$KILLS" ] || fail "only $killed kills in $KILLS rounds: transfers are too short here"
        store=s3://$bucket/killed/$rounds
        rm -rf b
        cut "$push_ms" "$TURBID" cache push --outputs a --store "$store"
        # What a killed push has left is pulled, or a part of it, by one that is killed, too.
        cut "$pull_ms" "$TURBID" cache pull --outputs b --store "$store"
        cut "$push_ms" "$TURBID" cache push --outputs a --store "$store"
        cache push a > /dev/null
        cut "$pull_ms" "$TURBID" cache pull --outputs b --store "$store"
        cut "$pull_ms" "$TURBID" cache pull --outputs b --store "$store"
        cache pull b > /dev/null
        is_whole b
    done
    is_whole a
    echo "   $killed kills in $rounds rounds; after each round the same digests, all sound"
    if grep -rlF -- "$AWS_SECRET_ACCESS_KEY" a b c d ./*.log ./*.err ./*.jsonl; then fail "the secret key stands in a file"; fi
    echo ok
}
