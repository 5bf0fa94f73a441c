"""Parameter files by ROS's rules: which block holds for which node, and who is told of a slip."""

from __future__ import annotations

import pytest

from binopos_ros.node_options import Parameters
from binopos_ros.parameter_files import Block, RosArguments
from binopos_ros.parameters import ParameterError
from binopos_ros.triangulation.errors import TriangulationError


@pytest.fixture
def written(tmp_path):
    def write(text, name='rig.yaml'):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize(
    ('key', 'matches', 'others'),
    [
        ('/**', ['/smoother', '/stereo/smoother', '/a/b/c'], []),
        ('/*', ['/smoother'], ['/stereo/smoother']),
        ('/**/smoother', ['/smoother', '/stereo/smoother', '/a/b/smoother'], ['/stereo/camera']),
        ('/*/smoother', ['/stereo/smoother'], ['/smoother', '/a/b/smoother']),
        ('/auv7/front/smoother', ['/auv7/front/smoother'], ['/stereo/smoother']),
        ('/auv7/**', ['/auv7/front/smoother', '/auv7/smoother'], ['/auv8/smoother']),
        ('smoother', ['/smoother'], ['/stereo/smoother']),
    ],
)
def test_a_key_matches_full_names_as_in_ros(key, matches, others):
    block = Block(key, {}, '')
    assert all(block.matches(name) for name in matches)
    assert not any(block.matches(name) for name in others)


def test_the_rig_is_told_by_its_namespace(written):
    path = written(
        '/**/triangulator: {ros__parameters: {epipolar_gate: 5.0, pair_tolerance: 0.002}}\n'
        '/auv7/front/triangulator: {ros__parameters: {epipolar_gate: 7.0}}\n'
    )
    front = Parameters([path], namespace='/auv7/front').of_node('triangulator')
    assert front == {'epipolar_gate': 7.0, 'pair_tolerance': 0.002}
    assert Parameters([path]).of_node('triangulator')['epipolar_gate'] == 5.0


def test_nested_and_joined_names_are_one(written):
    path = written('stereo: {smoother: {ros__parameters: {max_jump: 2}}}')
    assert Parameters([path]).of_node('smoother') == {'max_jump': 2.0}


def test_later_layers_win_value_by_value(written):
    first = written('/**/smoother: {ros__parameters: {max_jump: 1.0, max_speed: 1.0}}', 'a.yaml')
    second = written('/**/smoother: {ros__parameters: {max_jump: 2.0}}', 'b.yaml')
    parameters = Parameters([first, second], ['-p', 'smoother:max_gap:=3'])
    values = parameters.of_node('smoother')
    assert values == {'max_jump': 2.0, 'max_speed': 1.0, 'max_gap': 3.0}
    assert parameters.sources == [str(first), str(second), '-p smoother:max_gap:=3']


def test_words_can_rename_and_move_a_node(written):
    path = written('/auv/eye: {ros__parameters: {max_jump: 2.0}}')
    words = ['-r', 'smoother:__node:=eye', '-r', '__ns:=/auv', '--params-file', str(path)]
    parameters = Parameters(words=words)
    assert parameters.of_node('smoother') == {'max_jump': 2.0}
    assert parameters.others == words[:4]


@pytest.mark.parametrize('text', ['[1, 1.333]', '[1.0, 1.333]'])
def test_whole_numbers_are_taken_where_floats_are_meant(written, text):
    path = written(f'/**/triangulator: {{ros__parameters: {{interface.indices: {text}}}}}')
    assert Parameters([path]).of_node('triangulator')['interface.indices'] == (1.0, 1.333)


def test_numbers_are_read_as_ros_reads_them(written):
    path = written('/**/smoother: {ros__parameters: {wrong_share: 1e-6, output_rate: 0}}')
    assert Parameters([path]).of_node('smoother') == {'wrong_share': 1e-6, 'output_rate': 0.0}


def test_what_stands_under_a_wildcard_and_is_not_ours_is_left_alone(written):
    path = written(
        '/**: {ros__parameters: {robot_name: auv7, use_sim_time: false, max_jump: 2.0}}\n'
        '/**/ekf_filter_node: {ros__parameters: {frequency: 30.0}}\n'
    )
    parameters = Parameters([path])
    assert parameters.of_node('smoother') == {'max_jump': 2.0}
    assert parameters.given('smoother') == {'max_jump': 2.0, 'use_sim_time': False}
    assert parameters.of_node('detector') == {}
    assert parameters.notices() == []


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('/**/smoother:\n  ros__parameters:\n    max_jmp: 1.0\n', 'rig.yaml:3: unknown parameter'),
        (
            '/**/smoother:\n  ros__parameters:\n\n    max_jump: far\n',
            "rig.yaml:4: parameter 'max_",
        ),
        ('/**:\n  ros__parameters:\n    max_jump: -1.0\n', 'rig.yaml:3: parameter'),
        ('/**/smoother:\n  ros__parameters: {method: magic}\n', 'rig.yaml:2: parameter'),
        ('/**/smoother:\n  ros__parameters: [1]\n', 'rig.yaml:2: ros__parameters'),
        ('/**/smoother:\n  max_jump: 1.0\n', 'rig.yaml:2: /**/smoother/max_jump has no'),
        ('a: &a [1, 2]\nb: *a\n', 'rig.yaml:2: *a: parameter files have no aliases'),
        ('a: {b: [}\n', 'rig.yaml:1: is no YAML'),
        ('- a\n', 'rig.yaml:1: must begin with a node name'),
        ('[' * 20_000, 'levels deep'),
        ('#' * (2 << 20), 'larger than 1 MiB'),
    ],
)
def test_a_fault_is_told_with_file_and_line(written, text, said):
    path = written(text)
    with pytest.raises(ParameterError) as caught:
        Parameters([path]).of_node('smoother')
    assert said in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['-p', 'triangulater:method:=straight'], "did you mean 'triangulator'?"),
        (['-p', 'max_jmp:=1.0'], "did you mean 'max_jump'?"),
        (['-p', 'method'], 'write -p NODE:NAME:=VALUE'),
        (['--params-file', '/no/such.yaml'], '/no/such.yaml: cannot be read'),
    ],
)
def test_what_is_typed_and_means_nothing_is_refused(words, said):
    with pytest.raises(ParameterError) as caught:
        Parameters(words=words)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('/**/smother: {ros__parameters: {max_jump: 1.0}}', "did you mean 'smoother'?"),
        ('smoother: {ros__parameters: {max_jump: 1.0}}', 'write /**/smoother'),
    ],
)
def test_a_block_that_was_meant_for_a_node_and_holds_for_none_is_told(written, text, said):
    (notice,) = Parameters([written(text)]).notices()
    assert said in notice
    assert 'rig.yaml:1' in notice


def test_values_that_do_not_fit_together_are_told_before_a_node_starts(written):
    path = written('/**/triangulator: {ros__parameters: {method: paper}}')
    with pytest.raises(TriangulationError, match='needs an interface'):
        Parameters([path]).check('triangulator')


def test_words_without_parameters_are_handed_on():
    words = ['--ros-args', '--log-level', 'warn', '-p', 'smoother:max_jump:=1.0', '-r', 'a:=b']
    assert RosArguments.of(words).others == ['--log-level', 'warn', '-r', 'a:=b']


@pytest.mark.parametrize(
    ('interface', 'given', 'mirrored'),
    [
        ('interface.indices: [1, 1.333]', '', False),
        ('interface.indices: [1, 1.333]', 'mirror_above: true', True),
        # A tank's wall: the surface above the target mirrors it.
        ('interface.indices: [1, 1.5, 1.333]', '', None),
        ('left_port.indices: [1, 1.5, 1.333]', '', None),
    ],
)
def test_a_surface_seen_from_the_air_mirrors_nothing(written, interface, given, mirrored):
    path = written(
        f'/**/triangulator: {{ros__parameters: {{{interface}, target.diameter: 0.06}}}}\n'
        f'/**/detector: {{ros__parameters: {{{given}}}}}\n'
    )
    parameters = Parameters([path])
    assert parameters.of_node('detector').get('mirror_above') is mirrored
    assert parameters.of_node('smoother')['target_diameter'] == 0.06
