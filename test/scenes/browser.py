"""A headless Chromium, driven over its DevTools protocol."""

from __future__ import annotations

import base64
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time

import pytest
from websockets.sync.client import connect

NAMES = ('chromium-headless-shell', 'chromium', 'chromium-browser', 'google-chrome')
PATIENCE = 60.0
#: Set where a browser can be installed: then its absence is a failure.
REQUIRED = 'BINOPOS_BROWSER'


def found():
    """Path of a browser; the test skips, or fails where one is required."""
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        unavailable(f'no browser: none of {", ".join(NAMES)} is on the path')
    return path


def unavailable(reason):
    """Skip a test, or fail it where a browser is required."""
    if os.environ.get(REQUIRED) == 'required':
        pytest.fail(f'{reason}, and {REQUIRED} says that it is required')
    pytest.skip(reason)


class Browser:
    """One browser with one page."""

    def __init__(self, width=1280, height=900):
        self._profile = tempfile.TemporaryDirectory(
            prefix='binopos_browser_', ignore_cleanup_errors=True
        )
        self._process = subprocess.Popen(
            [
                *(found(), '--headless', '--no-sandbox', '--disable-gpu', '--mute-audio'),
                *('--remote-debugging-port=0', '--disable-dev-shm-usage', '--no-first-run'),
                *(f'--user-data-dir={self._profile.name}', '--lang=en', 'about:blank'),
            ],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        for line in self._process.stderr:
            if listening := re.search(r'ws://\S+', line):
                break
        else:
            pytest.fail('the browser did not start')
        self._numbers = itertools.count(1)
        self._session = None
        self._socket = connect(listening[0], max_size=None)
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        attached = self.call('Target.attachToTarget', targetId=target, flatten=True)
        self._session = attached['sessionId']
        self.call('Page.enable')
        self.resize(width, height)

    def call(self, method, **parameters):
        number = next(self._numbers)
        request = {'id': number, 'method': method, 'params': parameters}
        if self._session:
            request['sessionId'] = self._session
        self._socket.send(json.dumps(request))
        while True:
            answer = json.loads(self._socket.recv(PATIENCE))
            if answer.get('id') == number:
                assert 'error' not in answer, answer
                return answer['result']

    def resize(self, width, height, mobile=False):
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=mobile,
        )

    def open(self, address):
        self.call('Page.navigate', url=address)

    def run(self, script):
        """The value of an expression of JavaScript, awaited."""
        done = self.call(
            'Runtime.evaluate', expression=script, awaitPromise=True, returnByValue=True
        )
        assert 'exceptionDetails' not in done, done['exceptionDetails']
        return done['result'].get('value')

    def wait_for(self, script, what=''):
        deadline = time.monotonic() + PATIENCE
        while not (value := self.run(script)):
            assert time.monotonic() < deadline, what or script
            time.sleep(0.02)
        return value

    def press(self, key, shift=False):
        code = f'Key{key.upper()}' if key.isalpha() else key
        for kind in ('keyDown', 'keyUp'):
            self.call('Input.dispatchKeyEvent', type=kind, key=key, code=code, modifiers=8 * shift)

    def picture(self):
        """A PNG of what is shown."""
        return base64.b64decode(self.call('Page.captureScreenshot')['data'])

    def close(self):
        self._socket.close()
        # The command may be a script that starts the browser: all of them go.
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._process.stderr.close()
        self._profile.cleanup()
