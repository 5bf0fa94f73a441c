# Sourced in the guest before its script.

# Threads that wait for each other cost more than they gain on emulated processors.
export OPENCV_FOR_THREADS_NUM=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

load() { modprobe -d "$LAB/kernel" "$@"; }

wait_for() {
    for _ in $(seq 200); do
        [ -e "$1" ] && return 0
        sleep 0.05
    done
    echo "no $1 after 10 s" >&2
    return 1
}

# Two webcam-like capture devices of the kernel's own test driver.
load_vivid() { load vivid n_devs=2 node_types=0x1,0x1 num_inputs=1,1 input_types=0x0,0x0 "$@"; }

# The kernel's USB camera driver, and the virtual host controller that a camera is attached to.
load_uvc() { load vhci-hcd && load uvcvideo "$@"; }

# The daemon that makes /dev/v4l/by-id and by-path. Its name tells the one program what to be.
start_udev() {
    mkdir -p /run/udev /lib/udev
    cp -rn "$LAB"/udev/lib/udev/. /lib/udev/
    export SYSTEMD_IGNORE_CHROOT=1
    (exec -a systemd-udevd "$LAB/udev/bin/udevadm" --daemon)
}
