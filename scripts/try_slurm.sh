#!/usr/bin/env bash
# Trains blocks as batch systems do: in a shell loop, by GNU make, and by Slurm with a controller and two nodes on this
# machine. Each is stopped in the middle; one node of Slurm dies. Fails unless blocks continue from their checkpoints
# and all three ways end with the same splats. Slurm needs root and Debian's slurmctld, slurmd, slurm-client and munge.
#   scripts/try_slurm.sh [BIN]      folder of the commands, default: build/cpu/bin
set -euo pipefail
cd "$(dirname "$0")/.."
source=$PWD
bin=$(realpath "${1:-build/cpu/bin}")
export PATH=$bin:$PATH OMP_NUM_THREADS=1
work=$(mktemp -d)
declare -A started=() # processes, or groups of them (negative), that the end has to kill

clean_up() {
    for name in "${!started[@]}"; do kill -KILL -- "${started[$name]}" 2>/dev/null || true; done
    wait 2>/dev/null || true
    rm -rf "$work" 2>/dev/null || { sleep 1 && rm -rf "$work"; } # what was killed may still have written
}
trap clean_up EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

fail() {
    echo "try_slurm: $*" >&2
    exit 1
}
# wait_for SECONDS WHAT COMMAND...: until the command succeeds.
wait_for() {
    local left=$(($1 * 5)) what=$2
    shift 2
    until "$@" >/dev/null 2>&1; do
        ((left-- > 0)) || fail "$what: not after the time for it"
        sleep 0.2
    done
}
# Prints the iterations before a resumed training began, by its log; nothing if it began anew.
resumed_at() { sed -n 's/.*"event": "resumed", "iteration": \([0-9]*\).*/\1/p' "$1/run/log.jsonl" | tail -1; }
trains() { grep -q '"iteration": [0-9]*50,' "$1/run/log.jsonl"; }
# state FOLDER BLOCK: waiting, training, stopped or done.
state() { { tvsgs-blocks status "$1" || true; } | awk -v block="$2" '$1 == "block" && $2 == block { print $3 }'; }
none_trains() { for block in 1 2 3; do [[ $(state "$1" $block) != training ]] || return 1; done; }
has_checkpoint() { compgen -G "$1/run/checkpoints/*" >/dev/null && ! [[ -e $1/done.json ]]; }
require_resumed() {
    local at
    at=$(resumed_at "$1")
    [[ ${at:-0} -gt 0 ]] || fail "$1 began anew"
    echo "  ${1#"$work/"} went on from iteration $at"
}
require_all_done() {
    tvsgs-blocks status "$1" || fail "$1: not all blocks are done"
    [[ -z $(tvsgs-blocks status "$1" --missing) ]] || fail "$1: --missing names blocks"
}
split() { tvsgs-blocks split --coarse coarse --out "$1" --blocks 3 --margin 0.4 --iterations 600 --device cpu --quiet; }

for tool in make munged slurmctld slurmd sbatch unshare tvsgs-blocks; do
    command -v $tool >/dev/null || fail "$tool is missing"
done
[[ $(id -u) = 0 ]] || fail "Slurm's daemons need root"

cd "$work"
tvsgs-synth --out scene --wide 5 --views 14 --test-views 2 --width 64 --height 48 --points 3000 --quiet
cat >config.json <<'EOF'
{"scene": {"path": "scene", "split": "train_all"}, "backbone": "ewa", "init": {"min_points": 0},
 "densify": {"from": 20, "every": 15, "max_gaussians": 4500}}
EOF
tvsgs-train --config config.json --iterations 60 --out coarse --device cpu --quiet

by_shell() {
    echo "shell loop"
    split shell
    set -m # a process group of its own
    sh shell/commands.txt >shell.log 2>&1 &
    local loop=$!
    set +m
    started[loop]=-$loop
    wait_for 300 "block 1 in the shell loop" trains shell/block_001
    kill -TERM -- "-$loop"
    wait "$loop" && fail "the shell loop was faster than its end"
    unset "started[loop]"
    wait_for 60 "the checkpoint of block 1" none_trains shell
    [[ $(tvsgs-blocks status shell --missing) = 1-3 ]] || fail "status of the loop that was stopped"
    sh shell/commands.txt >>shell.log 2>&1 || fail "the shell loop: $(grep "^error" shell.log)"
    require_resumed shell/block_001
    require_all_done shell
    tvsgs-blocks merge shell --out shell_run --quiet
}

by_make() {
    echo "GNU make"
    split BLOCKS
    # The Makefile of the page.
    sed -n '/^    N := /,/^$/s/^    //p' "$source/docs/guide/blocks.md" >Makefile
    set -m
    make -j2 >make.log 2>&1 &
    local make=$!
    set +m
    started[make]=-$make
    wait_for 300 "block 2 by make" trains BLOCKS/block_002
    kill -TERM -- "-$make"
    wait "$make" && fail "make was faster than its end"
    unset "started[make]"
    wait_for 60 "the checkpoints of the blocks by make" none_trains BLOCKS
    make -j2 >>make.log 2>&1 || fail "make: $(grep -E "^error|\*\*\*" make.log)"
    require_resumed BLOCKS/block_002
    make -q || fail "make has something left to do"
    require_all_done BLOCKS
}

start_slurm() {
    local host
    host=$(hostname -s)
    chmod 755 "$work"
    mkdir state spool.n1 spool.n2
    dd if=/dev/urandom of=munge.key bs=64 count=1 status=none
    chmod 400 munge.key
    munged --foreground --force --key-file="$work/munge.key" --socket="$work/munge.sock" --pid-file="$work/munged.pid" \
        --log-file="$work/munged.log" --seed-file="$work/munge.seed" >munged.out 2>&1 &
    started[munged]=$!
    cat >slurm.conf <<EOF
ClusterName=try
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=27817
SlurmUser=root
AuthInfo=socket=$work/munge.sock
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool.%n
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.%n.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MpiDefault=none
SlurmdParameters=config_overrides
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=27818 CPUs=1
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=27819 CPUs=1
PartitionName=all Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
EOF
    export SLURM_CONF=$work/slurm.conf
    wait_for 20 "munged" munge -n -S "$work/munge.sock"
    slurmctld -D >slurmctld.out 2>&1 &
    started[slurmctld]=$!
    # A node is a namespace of processes; they all end with it, like on a machine that dies.
    for node in n1 n2; do
        unshare --pid --fork --kill-child --mount-proc slurmd -D -N $node >$node.out 2>&1 &
        started[$node]=$!
    done
    wait_for 60 "two idle nodes" two_idle_nodes
}
two_idle_nodes() { [[ $(sinfo -h -t idle -o %D) = 2 ]]; }
queue_is_empty() { [[ -z $(squeue -h) ]]; }
# Names block and node of a task that has a checkpoint.
find_victim() {
    while read -r block node; do
        has_checkpoint "slurm/block_00$block" || continue
        victim=$block victim_node=$node
        return
    done < <(squeue -h -t R -o '%K %N')
    return 1
}

by_slurm() {
    echo "Slurm $(slurmctld -V | sed 's/slurm-wlm //'), two nodes"
    start_slurm
    split slurm
    tvsgs-blocks slurm slurm --device cpu >job.sh
    local id merge
    id=$(sbatch --parsable job.sh --checkpoint-every 50)
    merge=$(sbatch --parsable --dependency=afterok:"$id" --output=merge.log \
        --wrap "tvsgs-blocks merge slurm --out slurm_run")
    wait_for 300 "a block with a checkpoint" find_victim
    [[ $(state slurm "$victim") = training ]] || fail "status: block $victim is $(state slurm "$victim")"

    kill -KILL "${started[$victim_node]}"
    wait "${started[$victim_node]}" 2>/dev/null || true
    unset "started[$victim_node]"
    scontrol update nodename="$victim_node" state=down reason=died
    wait_for 30 "block $victim in the queue again" is_requeued "${id}_$victim"
    [[ $(state slurm "$victim") = stopped ]] || fail "status: block $victim is $(state slurm "$victim")"
    echo "  node $victim_node has died; block $victim is in the queue again"
    scontrol update jobid="${id}_$victim" starttime=now # else two minutes later
    wait_for 600 "the end of all jobs" queue_is_empty
    require_resumed "slurm/block_00$victim"
    [[ $(grep -c 'iterations are done' "slurm/block_00$victim/train.log") = 1 ]] ||
        fail "block $victim: its log does not have both parts"
    require_all_done slurm
    scontrol show job "$merge" | grep -q JobState=COMPLETED || fail "merge: $(cat merge.log)"
}
is_requeued() { scontrol show job "$1" | grep -q 'Restarts=1'; }

by_shell
by_make
by_slurm
splats=point_cloud/iteration_600/point_cloud.ply
for run in RUN slurm_run; do
    cmp "shell_run/$splats" "$run/$splats" || fail "$run has other splats than shell_run"
done
echo "the same splats from the shell loop, make and Slurm"
