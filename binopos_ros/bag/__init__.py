"""Bags: rosbag2-compatible MCAP, read and written without ROS.

>>> import tempfile
>>> from binopos_ros.bag.messages import POSE
>>> from binopos_ros.bag.results import pose
>>> with tempfile.TemporaryDirectory() as folder:
...     with BagWriter(f'{folder}/dive.mcap') as writer:
...         writer.add_topic('/stereo/target/pose_stamped', POSE)
...         for stamp in (0, 33_000_000):
...             message = pose(stamp, 'left_camera_optical_frame', (0.1, 0.0, 1.2))
...             writer.write('/stereo/target/pose_stamped', stamp, message)
...     with BagReader(f'{folder}/dive.mcap') as reader:
...         for record in reader.messages():
...             print(record.stamp_ns, reader.decode(record).pose.position.z)
0 1.2
33000000 1.2
"""

from binopos_ros.bag.errors import BagError
from binopos_ros.bag.reader import BagReader
from binopos_ros.bag.records import Record, TopicInfo
from binopos_ros.bag.writer import BagWriter

__all__ = ['BagError', 'BagReader', 'BagWriter', 'Record', 'TopicInfo']
