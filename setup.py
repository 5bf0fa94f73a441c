"""Packaging of binopos_ros for pip and for colcon (ament_python)."""

from __future__ import annotations

import sys
from pathlib import Path

from setuptools import Extension, find_packages, setup

PACKAGE = 'binopos_ros'
#: colcon puts scripts where `ros2 run` looks; pip would put them on everybody's PATH.
BY_COLCON = bool({'install', 'develop'} & set(sys.argv))
NODES = ('camera', 'detector', 'triangulator', 'smoother', 'player', 'recorder', 'viewer')

setup(
    name=PACKAGE,
    version='0.1.0',
    description='Stereo positioning of a red target through refraction, live in ROS 2',
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={
        PACKAGE: ['py.typed'],
        f'{PACKAGE}.detection': ['*.pyi', '*.c'],
        f'{PACKAGE}.view': ['page/*'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (
            f'share/{PACKAGE}/config',
            sorted(str(path) for path in Path('config').iterdir() if path.is_file()),
        ),
        (
            f'share/{PACKAGE}/bags/demo',
            sorted(str(path) for path in Path('bags/demo').iterdir() if path.is_file()),
        ),
        *([] if BY_COLCON else [(f'lib/{PACKAGE}', [f'resource/run/{node}' for node in NODES])]),
    ],
    install_requires=[
        'numpy>=1.26',
        'opencv-python-headless>=4.6',
        'mcap>=1.2',
        'rosbags>=0.10',
        'pyusb>=1.2',
        'PyYAML>=6.0',
        'simplejpeg>=1.7',
        'websockets>=14',
    ],
    extras_require={
        'ros': ['ros-rclpy[fastrtps]==7.1.6', 'ros-common-interfaces==5.3.6'],
        # Built with every installation where it can be: nothing more has to be fetched.
        'fast': [],
        'reports': ['matplotlib>=3.8'],
        'completion': ['argcomplete>=3'],
    },
    entry_points={
        'console_scripts': [
            f'binopos = {PACKAGE}.cli:main',
            *(f'{node} = {PACKAGE}.nodes.executables:{node}' for node in NODES if BY_COLCON),
        ],
    },
    # Decodes the part of a JPEG that is looked at; without a compiler or the headers of
    # libjpeg-turbo it is left out, and pictures are decoded whole.
    ext_modules=[
        Extension(
            f'{PACKAGE}.detection._partial',
            [f'{PACKAGE}/detection/_partial.c'],
            libraries=['jpeg'],
            optional=True,
        )
    ],
    zip_safe=False,
)
