// The operator's page: takes what the server tells, and shows it.

import {Link, STALE_MS} from './link.js';
import {Eye} from './pictures.js';
import {Curves} from './curves.js';
import {Space} from './space.js';
import {showNumbers} from './numbers.js';
import {addEvents, showDrops, showNodes} from './lists.js';

const GRADES = {tracking: 'good', coasting: 'note', starting: 'note', degraded: 'warning', lost: 'alarm', silent: 'alarm'};
const WORDS = {
  tracking: 'Tracking', coasting: 'Coasting', starting: 'Starting', degraded: 'Degraded', lost: 'Lost',
  silent: 'No word', '': 'Nothing heard',
};
const find = (id) => document.getElementById(id);
const eyes = Object.fromEntries([...document.querySelectorAll('.eye')].map((each) => [each.dataset.side, new Eye(each)]));
const curves = new Curves(find('curves'));
const space = new Space(find('space'));
const page = {state: null, came: 0, mode: 'live', epoch: null, drawn: 0, keys: new Map()};
window.binopos = {page, eyes, curves};

const takers = {hello, state: takeState, mark: (mark) => eyes[mark.side].mark(mark), answer};
const link = new Link(
  (told) => takers[told.type]?.(told),
  (picture) => eyes[picture.side].add(picture),
  (words, isCut) => { find('link').textContent = words; find('link').classList.toggle('cut', isCut); },
);

function hello(told) {
  page.mode = told.mode;
  find('title').textContent = `binopos ${told.title}`;
  document.title = `${told.title} – binopos`;
  find('timeline').querySelector('ol').replaceChildren();
  curves.clear();
  find('controls').hidden = !told.buttons.length;
  find('buttons').replaceChildren(...told.buttons.map(({name, label, key, service}) => {
    const button = document.createElement('button');
    button.textContent = label;
    button.title = `${service}; keys Shift+${key.toUpperCase()}`;
    button.onclick = () => link.send({type: 'press', name});
    page.keys.set(`Shift+${key.toUpperCase()}`, [label, button.onclick]);
    return button;
  }));
  find('player').hidden = told.mode !== 'bag';
  find('drawn').hidden = told.mode === 'bag';
  if (told.mode === 'bag') {
    find('place').max = told.duration;
    // What is shown there: nothing else comes while the bag stands.
    link.send({type: 'seek', at: told.at});
  }
}

function takeState(state) {
  if (page.epoch !== null && state.epoch !== page.epoch) curves.clear();
  page.epoch = state.epoch;
  page.state = state;
  page.came = performance.now();
  curves.add(state.curves);
  addEvents(find('timeline').querySelector('ol'), state.events);
  show();
}

function answer({to, well, text}) {
  find('answer').textContent = `${well ? 'Done' : 'Not done'} (${to}): ${text}`;
  find('answer').dataset.grade = well ? 'good' : 'alarm';
}

function show() {
  const {state} = page, now = performance.now();
  if (!state) return;
  const isPaused = page.mode === 'bag' && !state.player.playing;
  const silence = (now - page.came) / 1000;
  const age = state.age === null ? null : state.age + silence;
  const word = link.isCut ? 'silent' : state.health.word;
  find('word').textContent = WORDS[word] ?? word;
  find('health').dataset.grade = find('word').dataset.grade = GRADES[word] ?? 'note';
  find('reason').textContent = link.isCut ? 'nothing comes from the server' : state.health.reason;
  find('remedy').textContent = link.isCut ? 'see whether the cable and binopos view are up' : state.health.remedy;
  showNumbers(find('numbers'), state, age, link.isCut || (!isPaused && (age === null || age * 1000 > STALE_MS)));
  for (const [side, eye] of Object.entries(eyes)) {
    if (isPaused) eye.shownAt = now;
    // Only while binopos calibrate --live runs.
    if (side === 'board') eye.figure.hidden = !state.pictures.board;
    if (!eye.figure.hidden) eye.tell(state.pictures[side], state.refused[side], link.isCut);
  }
  showRecorder(state.recorder);
  if (state.player) showPlayer(state.player);
  if (now - page.drawn > 180) {
    page.drawn = now;
    curves.draw();
    space.draw(state, curves.points);
    showNodes(find('nodes').querySelector('ul'), state.nodes, page.mode === 'live');
    showDrops(find('drops').querySelector('ul'), state.drops);
  }
}

function showRecorder(recorder) {
  const known = (value, digits, unit) => (value === null ? '' : `, ${value.toFixed(digits)} ${unit}`);
  find('recorder').textContent = recorder
    ? `Recorder: ${recorder.state} to ${recorder.bag}${known(recorder.duration, 0, 's')}${known(recorder.free, 1, 'GB free')}`
    : 'Nothing is recorded.';
}

function showPlayer({at, duration, playing}) {
  find('play').textContent = playing ? 'Pause' : 'Play';
  find('at').textContent = `${at.toFixed(1)} of ${duration.toFixed(1)} s`;
  if (document.activeElement !== find('place') || playing) find('place').value = at;
}

const isPlaying = () => page.state?.player?.playing;
find('play').onclick = () => link.send({type: isPlaying() ? 'pause' : 'play'});
find('back').onclick = () => link.send({type: 'step', by: -1});
find('on').onclick = () => link.send({type: 'step', by: 1});
const SEEK_MS = 120;
let seeking = 0;
find('place').oninput = () => {
  seeking ||= setTimeout(() => {
    seeking = 0;
    link.send({type: 'seek', at: Number(find('place').value)});
  }, SEEK_MS);
};
find('speed').onchange = () => link.send({type: 'speed', rate: Number(find('speed').value)});

function togglePictures() {
  const shown = find('pictures').getAttribute('aria-pressed') !== 'true';
  find('pictures').setAttribute('aria-pressed', shown);
  find('sight').hidden = !shown;
  link.watch(shown);
}

function toggleDrawn() {
  const drawn = find('drawn').getAttribute('aria-pressed') !== 'true';
  find('drawn').setAttribute('aria-pressed', drawn);
  link.watch(link.watches, drawn);
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  try { localStorage.setItem('theme', theme); } catch { /* a private window keeps nothing */ }
}

function keptTheme() {
  try { return localStorage.getItem('theme'); } catch { return null; }
}

const toggleTheme = () => setTheme(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark');

function toggleHelp() {
  const dialog = find('keys');
  if (dialog.open) { dialog.close(); return; }
  dialog.querySelector('ul').replaceChildren(...[...page.keys].map(([key, [label]]) => {
    const item = document.createElement('li'), name = document.createElement('kbd');
    name.textContent = key;
    item.append(name, label);
    return item;
  }));
  dialog.showModal();
}

find('pictures').onclick = togglePictures;
find('drawn').onclick = toggleDrawn;
find('theme').onclick = toggleTheme;
find('help').onclick = toggleHelp;
find('keys').querySelector('button').onclick = () => find('keys').close();
find('keys').onclose = () => find('help').setAttribute('aria-expanded', 'false');
const isBag = () => page.mode === 'bag';
for (const [key, label, action] of [
  ['P', 'show or hide the pictures', togglePictures],
  ['O', 'what the detector sees: candidates, and why they are refused', () => find('drawn').click()],
  ['T', 'light or dark', toggleTheme],
  ['?', 'these keys', toggleHelp],
  ['Space', 'a bag: play or pause', () => isBag() && find('play').click()],
  [',', 'a bag: one pose back', () => isBag() && find('back').click()],
  ['.', 'a bag: one pose on', () => isBag() && find('on').click()],
]) page.keys.set(key, [label, action]);

document.addEventListener('keydown', (event) => {
  const typing = ['INPUT', 'SELECT', 'BUTTON'].includes(event.target.tagName);
  if (event.ctrlKey || event.metaKey || event.altKey || (typing && event.key === ' ')) return;
  const letter = event.key === ' ' ? 'Space' : event.key.toUpperCase();
  const found = page.keys.get(event.shiftKey && /^[A-Z]$/.test(letter) ? `Shift+${letter}` : letter);
  if (found) { event.preventDefault(); found[1](); }
});

setTheme(keptTheme() ?? (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'));
setInterval(show, 100);
