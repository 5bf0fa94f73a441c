"""The stages of the live nodes on a bag, event by event, without ROS."""

from pathlib import Path

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import stamp_of
from binopos_ros.detection import decode
from binopos_ros.detection.images import image_of
from binopos_ros.node_options import Parameters
from binopos_ros.optics import read_camera_info
from binopos_ros.pipeline import Dropped, Located, Pipeline

BAG = Path(__file__).parent.parent / 'bags' / 'demo'
PAIRS = 12

parameters = Parameters([BAG / 'binopos.yaml'])
stages = ('detector', 'triangulator', 'smoother')
pipeline = Pipeline({name: parameters.of_node(name) for name in stages})
for side in ('left', 'right'):
    pipeline.set_camera(side, read_camera_info(BAG / f'{side}.yaml'))
topics = {f'/stereo/{side}/image_raw/compressed': side for side in ('left', 'right')}
poses, reasons = [], []
with BagReader(BAG) as bag:
    for record in bag.messages(topics=list(topics)):
        message = bag.decode(record)
        stamp, frame = stamp_of(message), decode(image_of(message))
        for event in pipeline.add(topics[record.topic], stamp, message.header.frame_id, frame):
            if isinstance(event, Located) and event.pose is not None:
                poses.append(event.pose.state.position)
            elif isinstance(event, Dropped):
                reasons.append(event.reason)
        if len(poses) == PAIRS:
            break
print(f'{len(poses)} poses, the last at {poses[-1].round(4)} m; dropped: {reasons or "none"}')
