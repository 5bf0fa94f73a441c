"""The SROS2 policy allows what the nodes do."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from binopos_ros.nodes.compose import NODES
from verbs import binopos

pytestmark = pytest.mark.live

STARTED = ('detector', 'triangulator', 'smoother')
LOOKS = {
    ('topics', 'publish'): 'get_publisher_names_and_types_by_node',
    ('topics', 'subscribe'): 'get_subscriber_names_and_types_by_node',
    ('services', 'reply'): 'get_service_names_and_types_by_node',
}


def allowed(profile, kind, verb):
    """Full names of what a profile allows."""
    namespace, node = profile.get('ns'), profile.get('node')
    names = [
        each.text
        for group in profile.findall(kind)
        if group.get(verb) == 'ALLOW'
        for each in group
    ]
    return {
        name
        if name.startswith('/')
        else f'{namespace}/{name.replace("~", node) if name.startswith("~") else name}'
        for name in names
    }


def test_it_allows_what_the_running_nodes_publish_hear_and_answer(start, peer, project):
    profiles = {
        each.get('node'): each
        for each in ET.parse(project / 'config' / 'sros2_policy.xml').iter('profile')
    }
    assert set(NODES) <= set(profiles)
    start(*STARTED, parameters={'triangulator': {'method': 'straight'}})
    every = {(name, '/stereo') for name in STARTED}
    peer.wait_for(
        lambda: every <= set(peer.node.get_node_names_and_namespaces()),
        'the nodes',
    )
    done = {}

    def complete():
        for name in STARTED:
            for (kind, verb), look in LOOKS.items():
                found = getattr(peer.node, look)(name, '/stereo')
                done[name, kind, verb] = {topic for topic, _ in found}
        return all(done.values())

    peer.wait_for(complete, 'what they do')
    for (name, kind, verb), used in done.items():
        assert used <= allowed(profiles[name], kind, verb), (name, kind, verb)


def test_every_node_asks_for_the_enclave_of_the_policy(ros_domain, project, tmp_path, monkeypatch):
    """Enforced without its keys, a node does not start, and says which enclave it wants."""
    enclaves = {
        each.get('path')
        for each in ET.parse(project / 'config' / 'sros2_policy.xml').iter('enclave')
    }
    (tmp_path / 'enclaves').mkdir()
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    for node in STARTED:
        assert f'/binopos/{node}' in enclaves
        straight = ('--ros-args', '-p', 'triangulator:method:=straight')
        done = binopos('run', '--enclaves', '/binopos', '--nodes', node, *straight)
        assert done.returncode == 2
        assert 'Traceback' not in done.stderr
        folder = tmp_path / 'enclaves' / 'binopos' / node
        assert 'ROS does not start: ' in done.stderr
        assert f"SECURITY ERROR: directory '{folder}' does not exist" in done.stderr
