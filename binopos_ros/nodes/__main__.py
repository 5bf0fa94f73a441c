"""`python -m binopos_ros.nodes NAME [NAME ...]`: one or more nodes composed in this process."""

from __future__ import annotations

import sys

from binopos_ros.nodes.supervised import prepare

prepare()

from binopos_ros.nodes.compose import compose  # noqa: E402 (signals first: rclpy loads slowly)

sys.exit(compose(sys.argv[1:]))
