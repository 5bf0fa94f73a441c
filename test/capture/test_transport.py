"""The profile for large images: used where needed, never in the user's way."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from binopos_ros.capture.transport import (
    PROFILE_SEGMENT,
    profile_environment,
    profile_variable,
)

PROFILE = Path('/share/config/fastdds.xml')
SMALL, LARGE = 400_000, 3_700_000


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_large_images_get_the_profile():
    assert profile_environment(PROFILE, LARGE, {}) == {profile_variable({}): str(PROFILE)}
    assert profile_environment(PROFILE, LARGE, {'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp'})


@pytest.mark.parametrize(
    ('release', 'variable'),
    [
        ('jazzy', 'FASTRTPS_DEFAULT_PROFILES_FILE'),
        ('kilted', 'FASTDDS_DEFAULT_PROFILES_FILE'),
        ('rolling', 'FASTDDS_DEFAULT_PROFILES_FILE'),
    ],
)
def test_each_ros_is_told_by_the_name_that_it_reads(release, variable):
    assert profile_environment(PROFILE, LARGE, {'ROS_DISTRO': release}) == {variable: str(PROFILE)}


@pytest.mark.parametrize(
    ('image_bytes', 'environment'),
    [
        (0, {}),
        (SMALL, {}),
        (LARGE, {'FASTRTPS_DEFAULT_PROFILES_FILE': '/mine.xml'}),
        (LARGE, {'FASTDDS_DEFAULT_PROFILES_FILE': '/mine.xml'}),
        (LARGE, {'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}),
    ],
)
def test_it_is_left_out_where_it_is_not_wanted(image_bytes, environment):
    assert profile_environment(PROFILE, image_bytes, environment) == {}


def test_a_profile_in_the_working_directory_is_the_users(tmp_path):
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').write_text('<profiles/>')
    assert profile_environment(PROFILE, LARGE, {}) == {}


def test_the_profile_holds_the_segment_that_is_counted_on(project):
    tree = ElementTree.parse(project / 'config/fastdds.xml')
    texts = {element.tag.rpartition('}')[2]: element.text for element in tree.iter()}
    assert int(texts['segment_size']) == PROFILE_SEGMENT
    assert texts['useBuiltinTransports'] == 'false'
