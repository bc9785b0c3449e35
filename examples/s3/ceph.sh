#!/usr/bin/env bash
# A store in S3 against the gateway of Ceph: one monitor, one OSD in memory and radosgw, all on 127.0.0.1. Needs radosgw,
# ceph-mon, ceph-osd and ceph (Debian: apt-get install radosgw ceph-mon ceph-osd ceph-common; done here if root runs it),
# none of which has to be set up; and boto3, which pip installs into a virtual environment, to make the bucket.
# usage: TURBID=turbid [KILLS=20] bash ceph.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
packages=(radosgw ceph-mon ceph-osd ceph-common)
if ! command -v radosgw ceph-mon ceph-osd ceph ceph-authtool monmaptool > /dev/null; then
    { [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; } ||
        fail "Ceph is not installed, and only root can: apt-get install ${packages[*]}"
    echo "apt-get install ${packages[*]}"
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends "${packages[@]}"; } \
        > apt.log 2>&1 || fail "apt-get cannot install them: $(tail -n 2 apt.log)"
fi
python boto3
mkdir mon osd run
port=$(free_port)
monitor="[v2:127.0.0.1:$(free_port),v1:127.0.0.1:$(free_port)]"
cluster=$(cat /proc/sys/kernel/random/uuid)
disk=$(cat /proc/sys/kernel/random/uuid)
cat > ceph.conf <<END
[global]
fsid = $cluster
mon host = $monitor
mon initial members = a
public addr = 127.0.0.1
cluster addr = 127.0.0.1
osd objectstore = memstore
memstore device bytes = 8589934592
osd pool default size = 1
osd pool default min size = 1
osd pool default pg num = 4
osd pool default pgp num = 4
osd crush chooseleaf type = 0
mon allow pool size one = true
mon data avail crit = 0
mon data = $WORK/mon
osd data = $WORK/osd
rgw data = $WORK/run
run dir = $WORK/run
admin socket = $WORK/run/\$name.asok
pid file = $WORK/run/\$name.pid
log file = $WORK/\$name.ceph
keyring = $WORK/keyring
rgw frontends = beast endpoint=127.0.0.1:$port
END
export CEPH_CONF=$WORK/ceph.conf
{
    ceph-authtool --create-keyring keyring --gen-key -n mon. --cap mon 'allow *'
    ceph-authtool keyring --gen-key -n client.admin --cap mon 'allow *' --cap osd 'allow *'
    ceph-authtool keyring --gen-key -n osd.0 --cap mon 'allow profile osd' --cap osd 'allow *'
    ceph-authtool keyring --gen-key -n client.gateway --cap mon 'allow rw' --cap osd 'allow *'
    monmaptool --create --addv a "$monitor" --fsid "$cluster" monmap
    ceph-mon --mkfs -i a --monmap monmap --keyring keyring
    begin monitor ceph-mon -i a -f
    timeout 60 ceph osd new "$disk" 0
    ceph-osd -i 0 --mkfs --osd-uuid "$disk"
    begin disk ceph-osd -i 0 -f
    begin gateway radosgw -n client.gateway -f
} > setup.log 2>&1 || fail "Ceph does not start: $(tail -n 3 setup.log)"
export AWS_ENDPOINT_URL=http://127.0.0.1:$port
answers "$AWS_ENDPOINT_URL/"
AWS_ACCESS_KEY_ID=AKIATURBIDCHECK
AWS_SECRET_ACCESS_KEY=$(python3 -c 'import secrets; print(secrets.token_hex(20))')
export AWS_ACCESS_KEY_ID AWS_SECRET_ACCESS_KEY
timeout 120 radosgw-admin user create --uid=lab --display-name=lab --access-key="$AWS_ACCESS_KEY_ID" \
    --secret="$AWS_SECRET_ACCESS_KEY" > user.json 2> user.err || fail "no user could be made: $(tail -n 3 user.err)"
client bucket turbid-check
echo "$(radosgw --version 2> /dev/null) at $AWS_ENDPOINT_URL"
check turbid-check
