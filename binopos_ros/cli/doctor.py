"""`binopos doctor`: what is wrong with the cameras, the files and ROS, and how to mend it."""

from __future__ import annotations

import argparse
import math
import os
import warnings
from collections.abc import Generator, Iterator, Mapping

from binopos_ros.capture import usb
from binopos_ros.capture.errors import DENIED, CaptureError
from binopos_ros.capture.formats import ENCODINGS, JPEG_FORMATS
from binopos_ros.capture.options import CaptureOptions
from binopos_ros.capture.survey import Reached, Survey, modes_of, survey
from binopos_ros.capture.usb import Camera
from binopos_ros.cli import machine
from binopos_ros.cli.config import add_config_argument, parameters_of
from binopos_ros.cli.findings import FAULT, NOTE, OK, WARNING, Finding
from binopos_ros.cli.installation import SYSTEMD_UNIT, UDEV_RULES, needed
from binopos_ros.cli.terminal import fitted
from binopos_ros.optics import stereo_contradictions, stereo_from_camera_infos
from binopos_ros.optics.camera_info_url import name_fault, read_calibration
from binopos_ros.optics.errors import OpticsError
from binopos_ros.parameters import CONTROLS, build
from binopos_ros.sides import SIDES

PRINTED = {'udev': UDEV_RULES, 'systemd': SYSTEMD_UNIT}
FEWEST_FRAMES = 0.9
"""Share of the frame rate that a camera must reach."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_config_argument(parser)
    parser.add_argument(
        '--seconds',
        type=float,
        default=2.0,
        help='how long to stream from the cameras of the rig (default: %(default)s)',
    )
    parser.add_argument(
        '--print',
        choices=PRINTED,
        help='print the udev rule for cameras, or a systemd unit for `binopos run`, and no more',
    )


def main(arguments: argparse.Namespace) -> int:
    """Print the findings; 1 where something has to be mended, else 0."""
    if arguments.print:
        print(needed(PRINTED[arguments.print]).read_text(encoding='utf-8'), end='')
        return 0
    options = None
    if arguments.config or arguments.ros_arguments:
        values = parameters_of(arguments).of_node('camera')
        options = build(
            CaptureOptions, {name: each for name, each in values.items() if CONTROLS not in name}
        )
    worst = OK
    for finding in findings(options, arguments.seconds):
        print(fitted(finding), flush=True)
        worst = max(worst, finding.level)
    return 1 if worst == FAULT else 0


def findings(options: CaptureOptions | None, seconds: float) -> Iterator[Finding]:
    """All that there is to say, in the order of the data's way."""
    yield from cameras(usb.find_cameras())
    if options is None:
        yield Finding(
            NOTE, 'rig', 'not looked at', 'name its parameter file: binopos doctor --config FILE'
        )
    else:
        reached = yield from rig(options, seconds)
        yield from calibration(options, reached)
    image_bytes = raw_image_bytes(options) if options else 0
    yield from machine.decoding(*(options or CaptureOptions()).view_size)
    yield from machine.ros(os.environ)
    yield from machine.transport(os.environ, image_bytes)
    yield from machine.clock()


def cameras(found: list[Camera]) -> Iterator[Finding]:
    """The cameras that are plugged in, and what they offer."""
    if not found:
        yield Finding(
            WARNING,
            'cameras',
            'none found',
            'plug one in; "lsusb" and "dmesg" tell whether the kernel sees it',
        )
    for camera in found:
        if camera.index:
            continue
        try:
            modes = modes_of(camera)
        except CaptureError as error:
            remedy = machine.UDEV_REMEDY if error.cause == DENIED else ''
            yield Finding(WARNING, 'camera', f'{camera}: {error}', remedy)
            continue
        largest: dict[str, str] = {}
        for mode in sorted(modes, key=lambda mode: math.prod(mode.largest)):
            largest[mode.pixel_format] = str(mode)
        offers = '; '.join(largest.values()) or 'no format that can be used'
        yield Finding(OK if modes else WARNING, 'camera', f'{camera}: up to {offers}')
        if not camera.serial and camera.bus:
            yield Finding(
                NOTE,
                'camera',
                f'{camera} has no serial number',
                f'name it by its port, {camera.port}, and keep it plugged in there',
            )


def rig(options: CaptureOptions, seconds: float) -> Generator[Finding, None, dict[str, Reached]]:
    """Stream from the rig's cameras; the findings, and in the end what was reached by side."""
    try:
        result = survey(options, seconds)
    except CaptureError as error:
        yield Finding(FAULT, 'rig', str(error), 'correct the parameters of the camera node')
        return {}
    for side, reached in result.sides.items():
        yield from _rate(side, reached, options)
        if options.usb_reset and reached.camera is not None:
            yield from machine.reset(reached.camera)
    yield from _skew(result, options)
    return result.sides


def calibration(options: CaptureOptions, reached: Mapping[str, Reached]) -> Iterator[Finding]:
    """Whether the calibration files are there and are those of the cameras."""
    urls = {'left': options.left.camera_info_url, 'right': options.right.camera_info_url}
    infos = {}
    for side, url in urls.items():
        if not url:
            yield Finding(
                WARNING,
                'calibration',
                f'{side}.camera_info_url is not set',
                'calibrate with "binopos calibrate stereo", and name the files it makes',
            )
            continue
        try:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter('always')
                infos[side] = read_calibration(side, url, options.view_size)
        except OpticsError as error:
            yield Finding(FAULT, 'calibration', str(error), 'correct the URL, or calibrate anew')
            continue
        for warning in told:
            yield Finding(WARNING, 'calibration', str(warning.message), 'calibrate anew')
    if len(infos) < len(SIDES):
        return
    try:
        *_, translation = stereo_from_camera_infos(infos['left'], infos['right'])
    except OpticsError as error:
        yield Finding(FAULT, 'calibration', str(error))
        return
    if exchanged := stereo_contradictions(infos['left'], infos['right']):
        yield from (Finding(FAULT, 'calibration', line) for line in exchanged)
        return
    serials = {side: one.camera.serial for side, one in reached.items() if one.camera is not None}
    faults = [
        name_fault(infos[side], serials.get(side, ''), serials.get(other, ''))
        for side, other in (SIDES, SIDES[::-1])
    ]
    for fault in filter(None, faults):
        yield Finding(FAULT, 'calibration', fault)
    if not any(faults):
        baseline = math.hypot(*translation)
        yield Finding(OK, 'calibration', f'both present, baseline {baseline:.4g} m')


def raw_image_bytes(options: CaptureOptions) -> int:
    """Size of a published raw image; 0 where the cameras' own JPEGs are passed on."""
    width, height = options.view_size
    if options.pixel_format in JPEG_FORMATS:
        return 3 * width * height if options.side_by_side else 0
    return ENCODINGS[options.pixel_format][1] * width * height


def _rate(side: str, reached: Reached, options: CaptureOptions) -> Iterator[Finding]:
    if reached.trouble or not reached.rate or reached.format is None:
        remedy = (
            '' if reached.trouble else 'see whether it waits for a trigger, or raise --seconds'
        )
        yield Finding(FAULT, side, reached.trouble or 'fewer than two frames came', remedy)
        return
    form = reached.format
    told = (
        f'{form.pixel_format} {form.width}x{form.height}: {reached.rate:.2f} of '
        f'{form.frame_rate:.4g} frames/s, {reached.lost} lost, {reached.corrupt} damaged, '
        f'largest {reached.frame_bytes / 1000:.0f} kB ({reached.camera})'
    )
    if form.frame_rate and reached.rate < FEWEST_FRAMES * form.frame_rate:
        yield Finding(
            WARNING,
            side,
            told,
            'give it more light or a fixed shorter exposure (exposure_dynamic_framerate off), '
            'and a USB controller of its own',
        )
    elif options.frame_rate and abs(form.frame_rate - options.frame_rate) > 0.01 * form.frame_rate:
        yield Finding(
            WARNING, side, told, f'it has no {options.frame_rate:g} frames/s; choose a rate it has'
        )
    else:
        yield Finding(OK, side, told)


def _skew(result: Survey, options: CaptureOptions) -> Iterator[Finding]:
    if options.side_by_side or any(one.trouble for one in result.sides.values()):
        return
    if result.skew is None:
        yield Finding(FAULT, 'pairs', 'none', 'raise pair_tolerance, or trigger the cameras')
        return
    skew = result.skew
    drift = '' if math.isnan(skew.drift) else f', drift {1e6 * skew.drift:.0f} ppm'
    told = (
        f'{skew.pairs} pairs, {result.unpaired} frames without a partner, skew '
        f'{1e3 * skew.median:.2f} ms in the median, {1e3 * skew.percentile_99:.2f} ms at 99 %'
        f'{drift}'
    )
    if skew.percentile_99 > 1e-3:
        yield Finding(
            NOTE,
            'pairs',
            told,
            'a target that moves is blurred by so much; a hardware trigger removes it',
        )
    else:
        yield Finding(OK, 'pairs', told)
