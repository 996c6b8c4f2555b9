#!/usr/bin/env bash
# A real Slurm on one machine, for tests: `up` installs what is missing (Debian's slurm-wlm and munge), writes
# /etc/slurm/slurm.conf and starts munged, slurmctld and slurmd without systemd; `down` ends exactly what `up` started.
#
#   slurm_on_one_machine.sh up               idempotent; ends when `sinfo` shows a node that takes jobs
#   slurm_on_one_machine.sh status           the daemons, the node and the jobs; 1 where something is missing
#   slurm_on_one_machine.sh down [--purge]   cancels all jobs; --purge also removes the packages that `up` installed
#
# As root, on a Debian 12 container or machine without a Slurm of its own. SLURM_CPUS (4) is how many CPUs the node
# claims to have: more than the machine has is fine, so that jobs find room beside the test that submits them.
set -euo pipefail

readonly STATE=/var/lib/slurm-on-one-machine  # keys, logs, spool and pid files; only `packages` outlives `down`
readonly CONF=/etc/slurm/slurm.conf
readonly MARK='# Written by tests/cluster/slurm_on_one_machine.sh, which also removes it.'
readonly DAEMONS=(munged slurmctld slurmd)  # in the order in which they start
readonly NO_DAEMONS=/usr/sbin/policy-rc.d  # Debian's way to say that installing a package starts nothing

die() {
  echo "slurm_on_one_machine.sh: $*" >&2
  exit 1
}

pid_of() {  # pid_of DAEMON: the process that this script started, nothing where it does not run
  local file=$STATE/$1.pid pid
  [[ $1 == munged ]] && file=$STATE/munge/munged.pid
  [[ -s $file ]] || return 0
  pid=$(<"$file")
  # the number may have gone to another program since; and a container's first process may not bury the dead (Z)
  [[ $(awk '/^(Name|State):/ {print $2}' "/proc/$pid/status" 2>/dev/null | paste -sd ' ') == "$1 "[!Z] ]] || return 0
  echo "$pid"
}

log_of() {
  [[ $1 == munged ]] && echo "$STATE/munge/munged.log" || echo "$STATE/$1.log"
}

quick() {  # a Slurm command that does not wait long for a controller that is gone
  timeout 10 "$@" 2>/dev/null
}

refuse_foreign() {
  [[ ! -e $CONF ]] || grep -qxF "$MARK" "$CONF" \
    || die "$CONF exists and is not this script's: this machine has a Slurm of its own, nothing was changed"
  local daemon pid
  for daemon in slurmctld slurmd; do
    for pid in $(pidof "$daemon" || true); do
      [[ $pid == "$(pid_of "$daemon")" ]] || die "a $daemon that this script did not start runs here (process $pid)"
    done
  done
}

installed() {
  dpkg-query -W -f '${db:Status-Status} ${Package}\n' | sed -n 's/^installed //p' | LC_ALL=C sort
}

install_packages() {
  if command -v munged slurmctld slurmd sbatch >/dev/null; then return; fi
  command -v apt-get >/dev/null || die "apt-get is missing: this script knows Debian's packages only"
  local before mine=
  before=$(installed)
  if [[ ! -e $NO_DAEMONS ]]; then
    mine=$NO_DAEMONS
    printf '#!/bin/sh\nexit 101\n' > "$NO_DAEMONS"
    chmod 755 "$NO_DAEMONS"
  fi
  echo "installing slurm-wlm and munge"
  local log=$STATE/apt.log failed=
  export DEBIAN_FRONTEND=noninteractive
  { apt-get update && apt-get install --yes --no-install-recommends slurm-wlm munge; } > "$log" 2>&1 || failed=yes
  [[ -z $mine ]] || rm -f "$mine"
  LC_ALL=C comm -13 <(echo "$before") <(installed) >> "$STATE/packages"
  [[ -z $failed ]] || die "apt-get failed, the end of $log says: $(tail -n 5 "$log")"
}

write_conf() {
  local cpus=${SLURM_CPUS:-4} memory node
  [[ $cpus =~ ^[1-9][0-9]*$ ]] || die "SLURM_CPUS is a number of CPUs, not '$cpus'"
  memory=$(awk '/^MemTotal:/ {print int($2 / 1024)}' /proc/meminfo)
  node=$(uname -n)
  node=${node%%.*}
  mkdir -p "$(dirname "$CONF")"
  cat > "$CONF" <<CONF
$MARK
ClusterName=one-machine
SlurmctldHost=$node(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$STATE/munge/munged.socket
StateSaveLocation=$STATE/slurmctld
SlurmdSpoolDir=$STATE/slurmd
SlurmctldPidFile=$STATE/slurmctld.pid
SlurmdPidFile=$STATE/slurmd.pid
SlurmctldLogFile=$STATE/slurmctld.log
SlurmdLogFile=$STATE/slurmd.log
MailProg=/bin/true

# a container: no cgroups (pgid also finds a process whose parent has died), no binding to CPUs, more of them than exist
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SlurmdParameters=config_overrides
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none

# jobs of one core side by side, each with the memory it asked for
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
DefMemPerCPU=$((memory / cpus))

# tests do not wait: a job is tried at once and ends five seconds after it was asked to
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_interval=2,bf_interval=2
KillWait=5
SlurmctldTimeout=10
SlurmdTimeout=30
ReturnToService=2

NodeName=$node NodeAddr=127.0.0.1 CPUs=$cpus RealMemory=$memory State=UNKNOWN
PartitionName=debug Nodes=$node Default=YES MaxTime=INFINITE State=UP
CONF
}

start() {  # start DAEMON COMMAND...: runs the command, which goes to the background by itself
  local daemon=$1 said
  shift
  [[ -z $(pid_of "$daemon") ]] || return 0
  said=$("$@" 2>&1) || die "$daemon does not start: $said $(tail -n 5 "$(log_of "$daemon")" 2>/dev/null)"
}

start_munged() {
  local folder=$STATE/munge
  install -d -o munge -g munge -m 755 "$folder"
  if [[ ! -s $folder/munge.key ]]; then
    head -c 1024 /dev/urandom > "$folder/munge.key"
    chown munge:munge "$folder/munge.key"
    chmod 400 "$folder/munge.key"
  fi
  start munged runuser -u munge -- "$(command -v munged)" --key-file "$folder/munge.key" \
    --socket "$folder/munged.socket" --pid-file "$folder/munged.pid" --log-file "$folder/munged.log" \
    --seed-file "$folder/munged.seed"
}

node_state() {
  quick sinfo --noheader --Node --format %T
}

wait_for_node() {
  local deadline=$((SECONDS + 60)) daemon state=unknown
  while ((SECONDS < deadline)); do
    state=$(node_state) || state=unknown
    case $state in
      idle | mixed | allocated) return ;;
      # jobs that could not be killed, or a machine that was cut off
      drain* | down*) quick scontrol update "nodename=$(quick sinfo -hN -o %N)" state=resume || true ;;
    esac
    sleep 0.5
  done
  for daemon in "${DAEMONS[@]}"; do
    echo "== $daemon, process $(pid_of "$daemon"), end of $(log_of "$daemon")" >&2
    tail -n 5 "$(log_of "$daemon")" >&2 || true
  done
  die "the node does not take jobs after 60 s: $state"
}

up() {
  refuse_foreign
  mkdir -p "$STATE"/{slurmctld,slurmd}
  install_packages
  # not under the feet of daemons that have read it
  [[ -n $(pid_of slurmctld) && -e $CONF ]] || write_conf
  start_munged
  start slurmctld slurmctld
  start slurmd slurmd
  wait_for_node
  sinfo
}

status() {
  local daemon missing=
  for daemon in "${DAEMONS[@]}"; do
    if [[ -n $(pid_of "$daemon") ]]; then
      echo "$daemon: process $(pid_of "$daemon"), log $(log_of "$daemon")"
    else
      echo "$daemon: does not run"
      missing=yes
    fi
  done
  [[ -z $missing ]] || exit 1
  quick sinfo || die "slurmctld does not answer"
  quick squeue
}

stop() {  # stop DAEMON: asks, and kills after ten seconds
  local pid deadline=$((SECONDS + 10))
  pid=$(pid_of "$1")
  [[ -n $pid ]] || return 0
  kill "$pid" 2>/dev/null || true
  while [[ -n $(pid_of "$1") ]]; do
    if ((SECONDS >= deadline)); then
      kill -KILL "$pid" 2>/dev/null || true
      return 0
    fi
    sleep 0.1
  done
}

cancel_jobs() {  # a job's processes would outlive slurmd
  [[ -n $(pid_of slurmctld) && -n $(pid_of slurmd) ]] || return 0
  local deadline=$((SECONDS + 30)) jobs
  while ((SECONDS < deadline)); do
    jobs=$(quick squeue --noheader --format %A) || return 0
    [[ -n $jobs ]] || return 0
    # shellcheck disable=SC2086  # a word a job
    quick scancel $jobs || true
    sleep 0.5
  done
  echo "slurm_on_one_machine.sh: jobs still end: ${jobs//$'\n'/ }" >&2
}

down() {
  [[ ${1:-} == "" || $1 == --purge ]] || die "down takes --purge only, not '$1'"
  refuse_foreign
  cancel_jobs
  stop slurmd
  stop slurmctld
  stop munged
  rm -f "$CONF"
  if [[ ${1:-} == --purge && -s $STATE/packages ]]; then
    xargs apt-get purge --yes < "$STATE/packages" > "$STATE/apt.log" 2>&1 \
      || die "apt-get purge failed: $(tail -n 5 "$STATE/apt.log")"
    rm -f "$STATE/packages"
  fi
  if [[ -d $STATE ]]; then
    find "$STATE" -mindepth 1 -not -path "$STATE/packages" -delete
    rmdir --ignore-fail-on-non-empty "$STATE"
  fi
  echo "no Slurm runs"
}

[[ $EUID -eq 0 ]] || die "only root can set up a Slurm"
case ${1:-} in
  up | status) "$1" ;;
  down) down "${2:-}" ;;
  *) die "one of: up, status, down [--purge]" ;;
esac
