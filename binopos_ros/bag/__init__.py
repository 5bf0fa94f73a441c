"""Bags: rosbag2-compatible MCAP, read and written without ROS."""

from binopos_ros.bag.errors import BagError
from binopos_ros.bag.reader import BagReader
from binopos_ros.bag.records import Record, TopicInfo
from binopos_ros.bag.writer import BagWriter

__all__ = ['BagError', 'BagReader', 'BagWriter', 'Record', 'TopicInfo']
