"""What is in a bag: topics, the first picture, and the truth of a simulated one."""

import sys
from pathlib import Path

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import position_of, stamp_of
from binopos_ros.detection import decode
from binopos_ros.detection.images import image_of

BAG = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent.parent / 'bags' / 'demo'

with BagReader(BAG) as bag:
    for name, topic in bag.topics.items():
        print(f'{topic.count:5d}  {name}  {topic.type}')
    record = next(bag.messages(topics=['/stereo/left/image_raw/compressed']))
    message = bag.decode(record)
    frame = decode(image_of(message))
    print(f'first picture: {frame.width}x{frame.height} px at {stamp_of(message) / 1e9:.3f} s')
    truth = [position_of(bag.decode(each)) for each in bag.messages(topics=['/stereo/truth/pose'])]
    print(f'the target swims from {truth[0].round(3)} to {truth[-1].round(3)} m')
