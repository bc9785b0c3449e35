#!/usr/bin/env bash
# Eight shards on Slurm: a controller and two nodes of one CPU on this machine, as root, with files in a folder of their own.
# Needs slurmctld, slurmd and munge (on Debian: apt-get install slurm-wlm munge), none of which has to be set up.
# usage: TURBID=turbid [KILLS=20] bash slurm.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
host=$(hostname -s)
export SLURM_CONF=$WORK/slurm.conf
mkdir -p state
dd if=/dev/urandom of=munge.key bs=1024 count=1 2> /dev/null
chmod 600 munge.key
cat > slurm.conf <<END
ClusterName=scratch
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmUser=root
SlurmdUser=root
AuthInfo=socket=$WORK/munge.socket
StateSaveLocation=$WORK/state
SlurmdSpoolDir=$WORK/spool-%n
SlurmctldPidFile=$WORK/slurmctld.pidfile
SlurmdPidFile=$WORK/slurmd-%n.pidfile
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_interval=2,sched_min_interval=0
SlurmdTimeout=30
KillWait=5
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
NodeName=n[1-2] NodeHostname=$host NodeAddr=127.0.0.1 Port=[16818-16819] CPUs=1 State=UNKNOWN
PartitionName=main Nodes=n[1-2] Default=YES MaxTime=INFINITE State=UP
END
begin() { # begin NAME COMMAND..
    local name=$1
    shift
    "$@" >> "$name.log" 2>&1 &
    echo $! > "$name.pid"
    disown
}
controller() { begin slurmctld slurmctld -D -f "$SLURM_CONF"; }
node() { begin "slurmd-n$1" slurmd -D -N "n$1" -f "$SLURM_CONF"; }
trap 'scancel --user=root 2>/dev/null || true; end slurmd-*.pid slurmctld.pid munged.pid' EXIT
begin munged munged --foreground --force --socket="$WORK/munge.socket" --key-file="$WORK/munge.key" \
    --pid-file="$WORK/munged.pidfile" --seed-file="$WORK/munge.seed" --log-file="$WORK/munged.log"
sleep 1
controller
node 1
node 2
for _ in $(seq 100); do
    [ "$(sinfo --noheader --format=%T 2> /dev/null)" = idle ] && break
    sleep 0.2
done
kill_node() {
    local node=$((RANDOM % 2 + 1))
    echo "kill -9: slurmd of node $node"
    kill -9 "$(cat "slurmd-n$node.pid")" 2>/dev/null
    node "$node"
    # As an administrator would: a node that lost its tasks is set aside.
    scontrol update NodeName=n[1-2] State=RESUME 2> /dev/null || true
}
kill_controller() {
    echo "kill -9: slurmctld"
    kill -9 "$(cat slurmctld.pid)" 2>/dev/null
    sleep 1
    controller
    sleep 2
    scontrol update NodeName=n[1-2] State=RESUME 2> /dev/null || true
}
reference
echo "eight shards on Slurm:"
"$TURBID" submit sweep.yaml "${set_to[@]}" --outputs slurm --engine slurm --shards 8 --task-seconds 0 --follow --retries 99 --json \
    > slurm.jsonl 2> slurm.err &
command=$!
kills "$command" kill_task kill_task kill_node kill_controller
wait "$command" || { tail slurm.jsonl slurm.err; exit 1; }
tail -n 1 slurm.jsonl
compare slurm
