"""A USB camera in user space: the kernel's own `uvcvideo` binds it, and it can be made to fail.

`usbip` speaks to the kernel's virtual host controller, `descriptors` says what the device is, and
`camera` is the device: it answers requests and streams JPEGs. Standard library only.
"""
