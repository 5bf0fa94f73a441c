"""`rig.yaml`, one parameter file for `binopos run`: the interface, the cameras and the target."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from binopos_ros.calibration.report.files import write_text
from binopos_ros.optics import CameraInfo
from binopos_ros.sides import SIDES

RIG_FILE = 'rig.yaml'
HEADER = (
    '# The rig, for `binopos run --config` and every other verb; the files that it names lie\n'
    '# beside it.\n# Written by `binopos calibrate interface`.'
)


def write_rig(
    folder: Path,
    interface: str,
    infos: Mapping[str, CameraInfo],
    serials: frozenset[str],
    diameter: float | None,
) -> tuple[Path, list[str]]:
    """Write the file; its path, and the parameters that are still to be set in it.

    Args:
        folder: of left.yaml, right.yaml and covariance.yaml.
        interface: the triangulator's block, as interface.yaml has it.
        infos: the calibrations by side. A camera that bears its serial number as its name, and is
            plugged in, is named by it.
        serials: of the cameras that are plugged in.
        diameter: of the target, m; None where it is not known.
    """
    block = interface[interface.index('/**/triangulator:') :].rstrip()
    missing = []
    lines = [HEADER, block]
    if diameter is not None:
        lines += ['    target:', f'      diameter: {float(diameter)!r}  # m']
    else:
        lines += ['    # target:', '    #   diameter: 0.04  # m, where it is known: sharper']
    lines += ['/**/camera:', '  ros__parameters:']
    for side in SIDES:
        lines.append(f'    {side}:')
        if infos[side].name in serials:
            lines.append(f'      device: {infos[side].name!r}  # its serial number')
        else:
            missing.append(f'{side}.device')
            lines.append(
                "      # device: ''  # serial number or USB port: `binopos doctor` has both"
            )
        lines.append(f'      camera_info_url: {side}.yaml')
    lines += [f'    width: {infos["left"].width}', f'    height: {infos["left"].height}']
    path = folder / RIG_FILE
    write_text(path, '\n'.join(lines) + '\n')
    return path, missing


def next_step(path: Path, missing: list[str]) -> str:
    """What to do with the file."""
    step = f'binopos run --config {path}'
    return f'set {" and ".join(missing)} in {path}, then {step}' if missing else step
