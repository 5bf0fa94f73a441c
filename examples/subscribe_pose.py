"""Take the target's pose from the live nodes; run it beside `binopos run` or `binopos replay`."""

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data


class Listener(Node):
    """Prints each pose with its standard deviation in depth."""

    def __init__(self):
        super().__init__('pose_listener')
        self.heard = 0
        self.create_subscription(
            PoseWithCovarianceStamped, '/stereo/target/pose', self.on_pose, qos_profile_sensor_data
        )

    def on_pose(self, message):
        place = message.pose.pose.position
        sigma = 1000 * message.pose.covariance[14] ** 0.5
        self.heard += 1
        print(f'{place.x:+.3f} {place.y:+.3f} {place.z:+.3f} m, depth +- {sigma:.1f} mm')


def main():
    rclpy.init()
    node = Listener()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
