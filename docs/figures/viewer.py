"""The pictures of the operator's page in docs/operation.md.

    python docs/figures/viewer.py

It processes the demo's bag, shows both bags on a page, and takes what a headless Chromium makes of
it: `viewer.jpg`, light and dark on a laptop and a phone. Chromium has to be on the path.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import cv2
import numpy as np

from binopos_ros.view.dive import Dive
from binopos_ros.view.options import ViewerOptions
from binopos_ros.view.recorded import BagPage

OUT = Path(__file__).with_name('viewer.jpg')
PROJECT = Path(__file__).resolve().parents[2]
DEMO = PROJECT / 'bags' / 'demo'
#: Theme, width and height, px.
LAPTOP, PHONE = ('light', 1280, 1240), ('dark', 390, 1240)
PLACE = 3.0

sys.path.insert(0, str(PROJECT / 'test' / 'scenes'))
from browser import Browser  # noqa: E402 (the path first)


def shot(browser: Browser, theme: str, width: int, height: int) -> np.ndarray:
    """The page as it looks in a window of that size."""
    browser.resize(width, height)
    browser.run(f'document.documentElement.dataset.theme = {theme!r}')
    time.sleep(1.0)
    return cv2.imdecode(np.frombuffer(browser.picture(), np.uint8), cv2.IMREAD_COLOR)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        processed = Path(folder) / 'demo.mcap'
        words = [sys.executable, '-m', 'binopos_ros', 'process', str(DEMO), '-o', str(processed)]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, cwd=PROJECT)
        with Dive([processed, DEMO]) as dive:
            page = BagPage(dive, ViewerOptions(port=0))
            running = threading.Thread(target=page.run, daemon=True)
            running.start()
            browser = Browser()
            browser.open(page.address)
            browser.wait_for('window.binopos?.page.state?.player')
            browser.run(
                'const place = document.getElementById("place"); place.focus();'
                f'place.value = {PLACE}; place.oninput()'
            )
            browser.wait_for(f'Math.abs(binopos.page.state.player.at - {PLACE}) < 0.1')
            shots = [shot(browser, *each) for each in (LAPTOP, PHONE)]
            browser.close()
            page.close()
            running.join()
    cv2.imwrite(str(OUT), np.hstack(shots), [cv2.IMWRITE_JPEG_QUALITY, 80])
    print(f'written: {OUT.name}')


if __name__ == '__main__':
    main()
