"""The operator's page: what a dive looks like from a browser, live and on a bag.

    messages ──▶ Screen (what there is to see) ──▶ PageServer (one port) ──▶ page/ (browser)

Nothing here needs ROS: a node (`binopos_ros.nodes.viewer`) or a bag (`recorded`) feeds it.
"""

from __future__ import annotations
