"""What goes wrong with a camera, in one line that says how to mend it."""

from __future__ import annotations

import errno as codes

GONE = 'gone'
BUSY = 'busy'
DENIED = 'denied'
FROZEN = 'frozen'
FAILED = 'failed'
INVALID = 'invalid'

_CAUSES = {
    codes.ENODEV: GONE,
    codes.ENOENT: GONE,
    codes.ENXIO: GONE,
    codes.EBUSY: BUSY,
    codes.EACCES: DENIED,
    codes.EPERM: DENIED,
    codes.EINVAL: INVALID,
    codes.ENOTTY: INVALID,
    codes.ERANGE: INVALID,
}


class CaptureError(ValueError):
    """A camera that cannot be found, opened, set up or read.

    :param message: one line: what, where, and what to do about it.
    :param cause: one of `GONE` (unplugged, or not there yet), `BUSY` (another program has it),
        `DENIED` (no rights), `FROZEN` (silent for too long), `FAILED` (the device or its driver
        gave up) and `INVALID` (the request is wrong: trying again will not help).
    """

    def __init__(self, message: str, cause: str = INVALID) -> None:
        super().__init__(message)
        self.cause = cause


def refused(error: OSError, what: str, path: str) -> CaptureError:
    """Turn the kernel's answer to a request into the one line for a person."""
    return _explain(error, what, path, _CAUSES.get(error.errno or 0, FAILED))


def broken(error: OSError, what: str, path: str) -> CaptureError:
    """Do the same for a request that is right and was accepted before.

    A running stream answers EINVAL when its driver is in trouble, which opening again may mend.
    """
    cause = _CAUSES.get(error.errno or 0, FAILED)
    return _explain(error, what, path, FAILED if cause == INVALID else cause)


def _explain(error: OSError, what: str, path: str, cause: str) -> CaptureError:
    if error.errno == codes.ENOSPC:
        remedy = (
            'the USB bus has no bandwidth left; choose MJPG, a smaller size or a lower rate, or '
            'put the cameras on different USB controllers'
        )
    else:
        remedy = {
            GONE: 'it is not plugged in; plug it in (again)',
            BUSY: f'another program uses it; "fuser -v {path}" names the program',
            DENIED: (
                'this user may not; join the group "video" or install the udev rule that '
                '"binopos doctor" offers'
            ),
            INVALID: 'its driver does not accept that; "binopos doctor" lists what it offers',
            FAILED: f'device or driver failed ({error.strerror}); replug it if it stays so',
        }[cause]
    return CaptureError(f'{path}: cannot {what}: {remedy}', cause)
