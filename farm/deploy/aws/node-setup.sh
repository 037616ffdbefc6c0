#!/bin/bash
# Makes a machine of EC2 a node. Its user data (farm.yaml) runs this, and has the functions `metadata`, `aws` and `download`.
set -uo pipefail

# carom-leave WHY: ends this machine and takes it off the size of its group, so that none comes in its place.
leave=/usr/local/sbin/carom-leave
{
    echo '#!/bin/bash'
    echo "AWS_REGION=$AWS_REGION imds=$imds"
    declare -f metadata aws
    cat <<'LEAVE'
# EC2 ends the machine itself, or systemd starts the node again.
[ "$(systemctl is-system-running)" != stopping ] || exit 0
[ "${SERVICE_RESULT:-success}" = success ] || exit 0
! metadata spot/instance-action >/dev/null || exit 0
echo "carom: this machine ends: $1" | tee /dev/console
query="Action=TerminateInstanceInAutoScalingGroup&InstanceId=$(metadata instance-id)"
query="$query&ShouldDecrementDesiredCapacity=true&Version=2011-01-01"
aws autoscaling "${AWS_ENDPOINT_URL:-https://autoscaling.$AWS_REGION.amazonaws.com}/?$query" >/dev/null || shutdown -h now
LEAVE
} >"$leave"
chmod 755 "$leave"
give_up() { "$leave" "$1"; exit 1; }

download "carom-farm-$(uname -m)" /usr/local/bin/carom-farm || give_up "there is no program for $(uname -m)"
chmod 755 /usr/local/bin/carom-farm
download carom-farm.service /etc/systemd/system/carom-farm.service || give_up "there is no unit"
mkdir -p /etc/systemd/system/carom-farm.service.d
cat >/etc/systemd/system/carom-farm.service.d/ec2.conf <<'END_OF_UNIT'
[Service]
StandardOutput=journal+console
StandardError=journal+console
ExecStopPost=+/usr/local/sbin/carom-leave "its node has ended"
END_OF_UNIT
echo "CAROM_NODE_OPTIONS=--spot-notice --exit-when-idle $CAROM_IDLE_EXIT" >/etc/default/carom-farm

# The token is tried for ten minutes; the key is made here, and only the service's user can read it.
joined=
for _ in {1..60}; do
    systemd-run --wait --pipe -p DynamicUser=yes -p User=carom-farm -p StateDirectory=carom-farm \
        -p StateDirectoryMode=0700 -p WorkingDirectory=/var/lib/carom-farm \
        carom-farm join "$CAROM_JOIN_URL" --name "$(metadata instance-id)" && joined=1 && break
    sleep "${CAROM_RETRY_SECS:-10}"
done
[ -n "$joined" ] || give_up "the farm's authority does not admit it"
systemctl enable carom-farm

# Vulkan's loader; for an NVIDIA GPU the driver with its Vulkan, built for Ubuntu's kernel.
export DEBIAN_FRONTEND=noninteractive
apt-get -q update
apt-get -qy install libvulkan1
if grep -qs 0x10de /sys/bus/pci/devices/*/vendor; then
    driver=580-server
    apt-get -qy install "linux-modules-nvidia-$driver-$(uname -r)" "nvidia-utils-$driver" "libnvidia-gl-$driver"
    if ! modprobe nvidia; then
        # This kernel has none any more: take the newest kernel, whose module is there.
        apt-get -qy install linux-aws "linux-modules-nvidia-$driver-aws" "nvidia-utils-$driver" "libnvidia-gl-$driver"
        reboot
        exit
    fi
fi
systemctl start carom-farm
