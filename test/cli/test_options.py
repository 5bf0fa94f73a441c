"""One rule for options in all verbs, and a hint where one is not known."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from types import SimpleNamespace

import pytest
import yaml

from binopos_ros.cli import VERBS, main, terminal
from binopos_ros.cli.completion import asked_verb
from binopos_ros.cli.parser import VerbParser, split_ros_arguments
from binopos_ros.cli.progress import progress, working
from binopos_ros.report import Report
from verbs import binopos_here


def parsers() -> dict[str, argparse.ArgumentParser]:
    """Each verb's parser by its name; those of `calibrate` are its kinds'."""
    found = {}
    for verb in VERBS:
        parser = VerbParser(prog=verb)
        importlib.import_module(f'binopos_ros.cli.{verb}').add_arguments(parser)
        kinds = [a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        more = {f'{verb} {kind}': each for choices in kinds for kind, each in choices.items()}
        found.update(more or {verb: parser})
    return found


def test_every_verb_takes_a_parameter_file():
    without = [name for name, each in parsers().items() if '--config' not in each.format_help()]
    assert without == []


def test_every_verb_says_what_each_of_its_options_does():
    mute = [
        f'{name} {action.dest}'
        for name, parser in parsers().items()
        for action in parser._actions
        if not action.help
    ]
    assert mute == []


@pytest.mark.parametrize(
    ('words', 'own', 'ros'),
    [
        ('BAG -p triangulator:method:=straight', 'BAG', '-p triangulator:method:=straight'),
        ('-p a:b:=1 BAG --ros-args -r c:=d -- -o OUT', 'BAG -o OUT', '-p a:b:=1 -r c:=d'),
        ('BAG -p', 'BAG -p', ''),
        ('-p BAG -p smoother:x:=1', '-p BAG', '-p smoother:x:=1'),
        ('BAG -m /a:=/b', 'BAG -m /a:=/b', ''),
    ],
)
def test_a_parameter_is_given_alike_with_and_without_ros_args(words, own, ros):
    assert split_ros_arguments(words.split()) == (own.split(), ros.split())


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('proces BAG', "did you mean 'process'?"),
        ('process BAG --ouput OUT', 'binopos process: error: there is no option --ouput: did you'),
        ('calibrate stereo --bord 9x6', 'calibrate stereo: error: there is no option --bord'),
        ('calibrate interfce', "did you mean 'interface'?"),
        ('simulate -o OUT more', "'more' is one argument too many"),
        ('process BAG -o OUT -p triangulator:methd:=paper', "did you mean 'method'?"),
        ('simulate -o OUT -p triangulator:methd:=paper', "did you mean 'method'?"),
        ('evaluate -o OUT -p smother:method:=kalman', "did you mean 'smoother'?"),
        ('calibrate convert A -o OUT -p triangulator:methd:=paper', "did you mean 'method'?"),
        ('calibrate camera A --square 0.1 --config none.yaml', 'there is no such parameter file'),
    ],
)
def test_a_slip_of_the_pen_is_refused_by_its_verb(demo_bag, tmp_path, words, said):
    places = {'BAG': demo_bag, 'OUT': tmp_path / 'out', 'A': tmp_path}
    done = binopos_here(*(places.get(word, word) for word in words.split()))
    assert done.returncode == 2
    assert said in done.stderr, done.stderr
    assert 'Traceback' not in done.stderr
    assert not (tmp_path / 'out').exists()


def test_what_a_simulation_is_given_goes_with_its_bag(tmp_path):
    bag = tmp_path / 'bag'
    words = ('--preset', 'demo', '--pairs', '2', '-p', 'triangulator:method:=straight')
    assert binopos_here('simulate', '-o', bag, *words).returncode == 0
    blocks = yaml.safe_load((bag / 'binopos.yaml').read_text())
    assert blocks['/stereo/triangulator']['ros__parameters'] == {'method': 'straight'}
    done = binopos_here('process', bag, '-o', tmp_path / 'out.mcap')
    told = next(line for line in done.stdout.splitlines() if 'position against truth' in line)
    # Straight rays miss the target by the water's bend.
    assert float(told.split('RMS')[1].split()[0]) > 50.0


def test_the_shell_may_complete_every_verb(monkeypatch, capfd):
    monkeypatch.setenv('_ARGCOMPLETE', '1')
    monkeypatch.setenv('COMP_LINE', 'binopos process --cs')
    assert asked_verb(os.environ) == 'process'
    assert asked_verb({}) == ''
    seen = []
    monkeypatch.setitem(sys.modules, 'argcomplete', SimpleNamespace(autocomplete=seen.append))
    with pytest.raises(SystemExit):
        main(['--version'])
    (verbs,) = [a.choices for a in seen[0]._actions if isinstance(a, argparse._SubParsersAction)]
    assert '--csv-all' in verbs['process'].format_help()
    assert '--csv-all' not in verbs['replay'].format_help()


class Terminal:
    """A stream that says that it is a terminal, with a clock that a test sets."""

    def __init__(self) -> None:
        self.text = ''
        self.now = 100.0

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self.text += text
        return len(text)

    def flush(self) -> None:
        pass

    def monotonic(self) -> float:
        return self.now


def test_the_time_that_is_left_is_told_by_the_pace_of_steps_alone(monkeypatch):
    """What comes before the first step, as opening a bag, is done once."""
    seen = Terminal()
    monkeypatch.setattr('sys.stderr', seen)
    monkeypatch.setattr('binopos_ros.cli.progress.time', seen)
    with progress('reading', 101) as tick:
        seen.now += 20.0
        tick()
        assert 'left' not in seen.text
        for _ in range(50):
            seen.now += 1.0
            tick()
    assert '51 of 101, 0:50 left' in seen.text


def test_long_work_is_told_in_a_terminal_and_taken_away(monkeypatch, capsys):
    with working('calibrating'):
        assert capsys.readouterr().err == ''
    seen = Terminal()
    monkeypatch.setattr('sys.stderr', seen)
    with working('calibrating'):
        assert seen.text == 'calibrating ...'
    assert seen.text.endswith('\r\x1b[K')


@pytest.mark.parametrize('when', ['add_arguments', 'main'])
def test_an_interrupt_is_quiet_however_early(monkeypatch, capsys, when):
    def interrupted(_):
        raise KeyboardInterrupt

    verb = SimpleNamespace(add_arguments=lambda _: None, main=lambda _: 0)
    setattr(verb, when, interrupted)
    monkeypatch.setitem(sys.modules, 'binopos_ros.cli.doctor', verb)
    assert main(['doctor']) == 130
    assert capsys.readouterr() == ('', '')


def test_a_report_fits_a_terminal_and_is_whole_in_a_pipe(monkeypatch):
    report = Report()
    report.drop('right: no target: the brightest red thing is smaller than min_diameter allows')
    report.note('a long note ' * 12)
    assert terminal.fitted(report) == str(report)
    monkeypatch.setattr('sys.stdout', Terminal())
    monkeypatch.setenv('COLUMNS', '80')
    folded = terminal.fitted(report)
    assert max(map(len, folded.splitlines())) <= 80
    assert folded.split() == str(report).split()


def test_a_replay_that_was_stopped_claims_nothing_about_the_truth():
    assert 'the bag holds no truth' in str(Report())
    stopped = str(Report(interrupted=True))
    assert 'truth' not in stopped
    assert 'before the end of the bag' in stopped
