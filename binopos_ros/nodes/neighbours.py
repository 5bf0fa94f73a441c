"""Who else is on this domain: second publishers of a topic, and nodes of the same name."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node


def publishers_of(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish a topic, in order; one that does twice stands twice."""
    return sorted(
        f'{each.node_namespace.rstrip("/")}/{each.node_name}'
        for each in node.get_publishers_info_by_topic(topic)
    )


def intruders(node: Node, sole_topics: Iterable[str]) -> dict[str, str]:
    """What is wrong with a node's neighbours, by what it is about; empty where all is well.

    Args:
        node: the node that looks about.
        sole_topics: full names of the topics that only one node should publish.
    """
    found = {}
    for topic in sole_topics:
        names = publishers_of(node, topic)
        if len(names) > 1:
            found[topic] = f'{topic} has {len(names)} publishers: {" and ".join(names)}'
    own = (node.get_name(), node.get_namespace())
    namesakes = node.get_node_names_and_namespaces().count(own)
    if namesakes > 1:
        found['name'] = (
            f'{namesakes} nodes are called {node.get_fully_qualified_name()}: is a second suite '
            'running? Stop one, or give it another namespace or ROS_DOMAIN_ID'
        )
    return found
