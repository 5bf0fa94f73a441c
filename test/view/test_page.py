"""The page in a real browser shows what the topics said, and looks old when it is."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from binopos_ros.drawn import BAND, in_page_colours, legend_above
from binopos_ros.sheet import Made, drawing, sheet, table
from binopos_ros.view.options import ViewerOptions
from binopos_ros.view.server import PageServer
from browser import Browser, found, unavailable
from page_server import Served, Told, diagnostics, health, pose

pytestmark = [pytest.mark.live, pytest.mark.xdist_group('browser')]

STAMP = 1_700_000_000 * 10**9
#: px, of a disc whose centre lies on no pixel's.
CENTRE = (331.25, 207.5)


@pytest.fixture(scope='module')
def browser():
    found()
    made = Browser()
    yield made
    made.close()


@pytest.fixture
def served(browser):
    made = Served(token='')
    browser.open(f'http://{made.authority}/')
    browser.wait_for('window.binopos && binopos.page.state !== null', 'the page')
    # What is shown before the page has asked for pictures goes to nobody.
    made.source.wait_until(lambda look: look.pictures)
    yield made
    made.server.close()


def jpeg():
    """A red disc on grey, its centre to a sixteenth of a pixel."""
    pixels = np.full((480, 640, 3), 90, np.uint8)
    centre = tuple(round(x * 16) for x in CENTRE)
    cv2.circle(pixels, centre, 30 * 16, (0, 0, 255), -1, cv2.LINE_AA, 4)
    return cv2.imencode('.jpg', pixels, (cv2.IMWRITE_JPEG_QUALITY, 95))[1].tobytes()


def show_all(served, stamp):
    for side in ('left', 'right'):
        mark = pose(stamp, (*CENTRE, 60.0))
        mark.pose.covariance[0] = mark.pose.covariance[7] = 1e-6
        served.take(f'{side}/centroid', mark)
        served.show(side, stamp, jpeg())
    covariance = np.diag([1e-8, 4e-8, 9e-6])
    served.take('target/pose', pose(stamp, (0.1234, -0.05, 1.2), covariance))
    served.take('target/health', health('tracking'))


#: The numbers, once target, pictures and numbers are shown as of now.
FRESH = """document.getElementById('word').textContent === 'Tracking'
  && !document.querySelector('.stale') && document.getElementById('numbers').innerText"""
#: The centre of what is drawn in the colour of the mark, and of what is red, px; (0, 0) is the
#: middle of the upper-left pixel.
CENTRES = """(() => {
  const canvas = document.querySelector('.eye canvas');
  const {data, width} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  const sums = {mark: [0, 0, 0], disc: [0, 0, 0]};
  for (let n = 0; n < data.length / 4; n++) {
    const [r, g, b] = data.subarray(4 * n, 4 * n + 3);
    if (r <= 150 || g >= 130) continue;
    const sum = sums[b > 90 ? 'mark' : 'disc'];
    sum[0] += n % width; sum[1] += Math.floor(n / width); sum[2]++;
  }
  return Object.fromEntries(Object.entries(sums).map(([k, [x, y, n]]) => [k, [x / n, y / n, n]]));
})()"""


def test_the_page_shows_the_pose_and_the_pictures_with_their_marks(browser, served):
    told = None
    while not told:
        # As often as it takes: a machine that is busy shows it old, and rightly.
        show_all(served, STAMP)
        told = browser.run(FRESH)
    for words in ('0.1234 m', '-0.0500 m', '1.2000 m', '± 0.10 mm', '± 0.20 mm', '± 3.0 mm'):
        assert words in told
    for side in ('left', 'right'):
        shown = browser.wait_for(f'binopos.eyes.{side}.shown')
        assert (shown['stamp'], shown['mark']['stamp']) == (str(STAMP), str(STAMP))
    # A second later all of it is old, and looks so.
    browser.wait_for("document.querySelectorAll('.eye.stale').length === 2")
    browser.wait_for("document.getElementById('numbers').classList.contains('stale')")


def test_the_mark_lies_over_the_target_to_half_a_pixel(browser, served):
    show_all(served, STAMP)
    browser.wait_for('binopos.eyes.left.shown?.mark')
    centres = browser.run(CENTRES)
    assert centres['mark'][2] > 50
    assert centres['disc'][2] > 1000
    assert centres['mark'][:2] == pytest.approx(CENTRE, abs=0.5)
    assert centres['disc'][:2] == pytest.approx(CENTRE, abs=0.5)


def test_alarms_come_with_their_remedy(browser, served):
    served.take('target/health', health('tracking'))
    trouble = 'left: /dev/video0: cannot read: it is not plugged in; plug it in (again)'
    served.take('/diagnostics', diagnostics('camera', 2, trouble))
    served.take('target/health', health('lost', 'no position was used for 0.5 s'))
    browser.wait_for("document.getElementById('word').textContent === 'Lost'")
    assert 'look at both pictures' in browser.run("document.getElementById('remedy').textContent")
    events = browser.run("document.getElementById('timeline').innerText")
    assert trouble in events
    assert 'target found' in events


def test_it_connects_again_to_a_server_that_was_started_again(browser, served):
    port = served.server.port
    served.server.close()
    browser.wait_for("document.getElementById('link').classList.contains('cut')")
    browser.wait_for("document.getElementById('word').textContent === 'No word'")
    again = PageServer(ViewerOptions(port=port), Told())
    again.start()
    try:
        browser.wait_for("!document.getElementById('link').classList.contains('cut')")
        assert browser.run("document.getElementById('link').textContent") == 'connected'
    finally:
        again.close()


def test_a_wrong_token_is_told(browser):
    served = Served(token='the right one')
    try:
        browser.open(f'http://{served.authority}/?token=wrong')
        told = "document.getElementById('link')?.textContent.startsWith('wrong token')"
        browser.wait_for(told)
    finally:
        served.server.close()


def test_what_the_calibrator_sees_is_there_while_it_works(browser, served):
    board = "document.querySelector('[data-side=board]')"
    show_all(served, STAMP)
    browser.wait_for('binopos.eyes.left.shown')
    assert browser.run(f'{board}.hidden')
    served.show('board', STAMP, jpeg())
    served.show('board', STAMP + 1, jpeg())
    browser.wait_for('binopos.eyes.board.shown')
    browser.wait_for(f'!{board}.hidden')
    assert browser.run(OVERLAPS) == []


def test_keys_work_and_pictures_that_are_hidden_are_not_sent(browser, served):
    browser.press('t')
    assert browser.run('document.documentElement.dataset.theme') == 'dark'
    browser.press('t')
    assert browser.run('document.documentElement.dataset.theme') == 'light'
    served.source.wait_until(lambda look: look.pictures)
    browser.press('p')
    served.source.wait_until(lambda look: not look.pictures)
    assert browser.run("document.getElementById('sight').hidden")


@pytest.mark.parametrize('theme', ['light', 'dark'])
def test_it_is_legible_at_every_width(browser, served, axe, theme):
    if browser.run('document.documentElement.dataset.theme') != theme:
        browser.press('t')
    show_all(served, STAMP)
    served.take('/diagnostics', diagnostics('detector', 2, 'left/camera_info cannot be used'))
    browser.wait_for('binopos.eyes.left.shown')
    for width in (390, 1280, 1920):
        browser.resize(width, 900)
        assert browser.run('document.documentElement.scrollWidth') <= width
        assert browser.run(OVERLAPS) == []
    browser.resize(1280, 900)
    assert violations(browser, axe) == []


@pytest.mark.parametrize('theme', ['light', 'dark'])
def test_a_report_is_legible_on_a_phone_and_on_a_desk(browser, axe, theme, tmp_path):
    pytest.importorskip('matplotlib', reason='matplotlib is not installed')
    drawn = in_page_colours(figure_of_everything)()
    wide = table([('a row', *['1234.5 .. 6789.0'] * 12)], ['a head', *['of a column (mm)'] * 12])
    body = [f'<h2>Words</h2><p>{"words " * 50}</p>', wide, drawing(drawn, 'Errors')]
    path = tmp_path / 'report.html'
    made = Made('binopos evaluate -o a_folder_with_a_name_as_long_as_this', ['bag: 5 bytes'])
    path.write_text(sheet('A report', body, made), encoding='utf-8')
    browser.call(
        'Emulation.setEmulatedMedia', features=[{'name': 'prefers-color-scheme', 'value': theme}]
    )
    try:
        browser.open(path.as_uri())
        browser.wait_for("document.readyState === 'complete' && !!document.querySelector('svg')")
        for width in (390, 1280, 1920):
            browser.resize(width, 900)
            assert browser.run('document.documentElement.scrollWidth') <= width
            # Not too small to read.
            assert browser.run(SMALLEST_WORD) >= 10
        assert browser.run(COVERED) == []
        browser.resize(1280, 900)
        assert violations(browser, axe) == []
    finally:
        browser.call('Emulation.setEmulatedMedia', features=[])


def violations(browser, axe):
    """What axe-core finds against WCAG's levels A and AA in the page that is open."""
    # Not as modules would: the operator's page's own policy lets no other script in.
    browser.run(axe)
    return browser.run(
        "axe.run({runOnly: ['wcag2a', 'wcag2aa']}).then((done) => done.violations"
        '.map((each) => [each.id, each.nodes.map((node) => node.html)]))'
    )


def figure_of_everything():
    """Two axes, three curves, a band and a legend."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2), layout='constrained')
    for axes in figure.subplots(1, 2):
        for number in range(3):
            axes.plot([1, 2, 3], [0, number, 1], label=f'curve {number}')
        axes.axhspan(-4, 4, color=BAND, alpha=0.15, label='a band, \u00b14 mm')
        axes.set(xlabel='pair (number)', ylabel='error (mm)', title='x')
    legend_above(figure)
    return figure


#: The smallest height of words in a drawing, px.
SMALLEST_WORD = """Math.min(...[...document.querySelectorAll('svg text')].map((each) => {
  const {a, b} = each.getScreenCTM();
  return parseFloat(getComputedStyle(each).fontSize) * Math.hypot(a, b);
}))"""
#: Words of a drawing that lie over one another, or over a curve.
COVERED = """(() => {
  const boxes = [...document.querySelectorAll('svg text')]
    .map((each) => [each.textContent, each.getBoundingClientRect()]);
  const legend = boxes.filter(([words]) => /^(curve|a band)/.test(words));
  const found = [];
  for (const [words, a] of legend) for (const [other, b] of boxes) {
    if (words !== other && Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
      && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1) found.push([words, other]);
  }
  const top = Math.min(...boxes.filter(([words]) => words === 'x').map(([, box]) => box.top));
  for (const [words, box] of legend) if (box.bottom > top) found.push([words, 'the axes']);
  return found;
})()"""


#: Pairs of the page's parts that cover each other.
OVERLAPS = """(() => {
  const parts = [...document.querySelectorAll('main > *, #sight figure, #numbers dl > div')]
    .filter((each) => each.offsetWidth);
  const found = [];
  for (const a of parts) for (const b of parts) {
    if (a === b || a.contains(b) || b.contains(a)) continue;
    const [p, q] = [a.getBoundingClientRect(), b.getBoundingClientRect()];
    if (Math.min(p.right, q.right) - Math.max(p.left, q.left) > 1
      && Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 1) found.push([a.id, b.id]);
  }
  return found;
})()"""


@pytest.fixture(scope='module')
def axe(project):
    """axe-core, from the npm registry, kept beside the tests' environment."""
    pins = (Path(__file__).parent / 'package.json').read_text()
    version = json.loads(pins)['dependencies']['axe-core']
    folder = project / '.venv' / f'axe-core-{version}'
    script = folder / 'node_modules' / 'axe-core' / 'axe.min.js'
    if not script.is_file():
        if shutil.which('npm') is None:
            unavailable('npm is not installed: it fetches axe-core')
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'package.json').write_text(pins)
        words = ('npm', 'install', '--ignore-scripts', '--no-audit', '--no-fund', '--no-progress')
        done = subprocess.run(
            words, cwd=folder, capture_output=True, text=True, timeout=120, check=False
        )
        if done.returncode:
            unavailable(f'the npm registry gives no axe-core: {done.stderr.strip()[-200:]}')
    return script.read_text()
