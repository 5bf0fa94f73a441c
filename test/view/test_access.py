"""Who needs a token for the page."""

from __future__ import annotations

from binopos_ros.view.access import TOKEN_VARIABLE, Access


def test_a_viewer_that_is_started_again_keeps_the_token_of_its_supervisor(monkeypatch):
    assert Access('0.0.0.0').token != Access('0.0.0.0').token
    monkeypatch.setenv(TOKEN_VARIABLE, 'kept')
    assert Access('0.0.0.0').token == 'kept'
    assert Access('127.0.0.1').token == ''


def test_this_machine_alone_needs_none():
    for address in ('127.0.0.1', '::1', 'localhost', '127.8.8.8'):
        assert Access(address).token == ''
    for address in ('0.0.0.0', '::', '192.168.2.2', 'robot.local'):
        assert Access(address).token
    assert Access('127.0.0.1', 'mine').token == 'mine'
