"""The structures and request numbers are those of the kernel's own header."""

from __future__ import annotations

import ctypes
import platform
import shutil
import subprocess
from pathlib import Path

import pytest

from binopos_ros.capture import kernel as v4l2

REQUESTS = sorted(name for name in vars(v4l2) if name.startswith('VIDIOC_'))
CONSTANTS = sorted(
    name
    for name in vars(v4l2)
    if name.startswith(('CAP_', 'BUF_FLAG_', 'CTRL_TYPE_', 'CTRL_FLAG_'))
)


def test_every_structure_has_the_size_that_the_kernel_expects():
    for structure, (name, size) in v4l2.SIZES.items():
        assert ctypes.sizeof(structure) == size, name


def test_every_request_carries_the_size_of_its_structure():
    # The upper half of a request's number holds the size of its argument.
    structures = {
        'QUERYCAP': v4l2.Capability,
        'ENUM_FMT': v4l2.FormatDescription,
        'S_FMT': v4l2.Format,
        'REQBUFS': v4l2.RequestBuffers,
        'DQBUF': v4l2.Buffer,
        'S_PARM': v4l2.StreamParameters,
        'QUERYMENU': v4l2.QueryMenu,
        'S_EXT_CTRLS': v4l2.ExtendedControls,
        'QUERY_EXT_CTRL': v4l2.QueryExtendedControl,
        'ENUM_FRAMESIZES': v4l2.FrameSizeEnumeration,
        'ENUM_FRAMEINTERVALS': v4l2.FrameIntervalEnumeration,
    }
    for name, structure in structures.items():
        request = getattr(v4l2, f'VIDIOC_{name}')
        assert request >> 16 & 0x3FFF == ctypes.sizeof(structure), name


def test_sizes_offsets_and_numbers_agree_with_the_c_compiler(tmp_path):
    if platform.machine() not in ('x86_64', 'aarch64'):
        pytest.skip(f'the layout is that of x86-64 and aarch64, not of {platform.machine()}')
    if shutil.which('gcc') is None or not Path('/usr/include/linux/videodev2.h').exists():
        pytest.skip('gcc and linux/videodev2.h are needed to ask the C compiler')
    offsets = {
        ('v4l2_buffer', 'timestamp'): v4l2.Buffer.timestamp.offset,
        ('v4l2_buffer', 'sequence'): v4l2.Buffer.sequence.offset,
        ('v4l2_buffer', 'm'): v4l2.Buffer.m.offset,
        ('v4l2_buffer', 'length'): v4l2.Buffer.length.offset,
        ('v4l2_format', 'fmt'): v4l2.Format.fmt.offset,
        ('v4l2_query_ext_ctrl', 'minimum'): v4l2.QueryExtendedControl.minimum.offset,
        ('v4l2_query_ext_ctrl', 'flags'): v4l2.QueryExtendedControl.flags.offset,
        ('v4l2_ext_controls', 'controls'): v4l2.ExtendedControls.controls.offset,
        ('v4l2_frmivalenum', 'discrete'): v4l2.FrameIntervalEnumeration.interval.offset,
        ('v4l2_captureparm', 'timeperframe'): v4l2.CaptureParameters.timeperframe.offset,
    }
    lines = ['#include <stddef.h>', '#include <stdio.h>', '#include <linux/videodev2.h>']
    lines += ['int main(void) {']
    for name, _ in v4l2.SIZES.values():
        lines.append(f'printf("%zu\\n", sizeof(struct {name}));')
    for structure, member in offsets:
        lines.append(f'printf("%zu\\n", offsetof(struct {structure}, {member}));')
    for name in REQUESTS:
        lines.append(f'printf("%lu\\n", (unsigned long)(unsigned){name});')
    for name in CONSTANTS:
        lines.append(f'printf("%lu\\n", (unsigned long)(unsigned)V4L2_{name});')
    source, program = tmp_path / 'sizes.c', tmp_path / 'sizes'
    source.write_text('\n'.join([*lines, 'return 0; }']))
    subprocess.run(['gcc', '-o', program, source], check=True)
    answers = subprocess.run([program], check=True, capture_output=True, text=True)
    ours = [size for _, size in v4l2.SIZES.values()]
    ours += list(offsets.values())
    ours += [getattr(v4l2, name) for name in REQUESTS + CONSTANTS]
    assert ours == [int(line) for line in answers.stdout.split()]


def test_linux_says_what_the_kernel_says(tmp_path):
    linux = v4l2.Linux()
    with pytest.raises(FileNotFoundError):
        linux.open(str(tmp_path / 'absent'))
    plain = tmp_path / 'plain'
    plain.write_bytes(b'x' * 8192)
    descriptor = linux.open(str(plain))
    try:
        with pytest.raises(OSError, match='Inappropriate ioctl'):
            linux.ioctl(descriptor, v4l2.VIDIOC_QUERYCAP, v4l2.Capability())
        mapped = linux.map(descriptor, 4096, 4096)
        assert bytes(mapped[:1]) == b'x'
        mapped.close()
        assert linux.poll(descriptor, 0.0)
    finally:
        linux.close(descriptor)
