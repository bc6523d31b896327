#!/bin/sh
# First process of the user-mode kernel: this machine's files (read only), a kernel of its own.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin TMPDIR=/dev/shm HOME=/dev/shm
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
mkdir -p /dev/pts /dev/shm
mount -t devpts -o mode=666,ptmxmode=666 devpts /dev/pts
mount -t tmpfs tmpfs /dev/shm
ip link set lo up
cd "$UML_REPOSITORY" || exit 1
"$UML_PYTHON" -B -m "$UML_MODULE"
"$UML_PYTHON" -c "import ctypes; ctypes.CDLL(None).reboot(0x4321FEDC)"
