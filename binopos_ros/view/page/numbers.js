// The figures, each with its unit; one that is not known is a dash.

const figure = (value, digits, unit) => (value === null || value === undefined ? '–' : `${value.toFixed(digits)} ${unit}`);

function millimetres(metres) {
  const value = metres * 1000;
  return `± ${value.toFixed(value < 1 ? 2 : 1)} mm`;
}

export function rows(state, age) {
  const {pose, index, latency} = state;
  const axes = ['x', 'y', 'z'].map((name, n) => [
    name, figure(pose?.position[n], 4, 'm'), pose ? millimetres(pose.deviation[n]) : '',
  ]);
  const waves = state.waves === null ? [] : [['Waves', figure(state.waves, 2, 'pixel noises'), '']];
  return [
    ...axes,
    ['Distance', figure(state.distance, 3, 'm'), 'from the left camera'],
    ['Speed', figure(state.speed, 3, 'm/s'), state.speed_std === null ? '' : `${millimetres(state.speed_std)}/s`],
    ['Age', figure(age, 1, 's'), 'of the newest pose', 'fresh'],
    ['Rate', figure(state.rate, 1, '/s'), 'poses'],
    ['Latency', figure(latency.median === null ? null : latency.median * 1000, 0, 'ms'),
      latency.p99 === null ? 'stamps are of another time' : `${(latency.p99 * 1000).toFixed(0)} ms at the most (99 %)`],
    ['Index', index ? index.mean.toFixed(4) : '–', index ? `± ${index.std.toFixed(4)}, ${index.verdict}` : 'refractive'],
    ...waves,
  ];
}

export function showNumbers(section, state, age, isStale) {
  const list = section.querySelector('dl');
  section.classList.toggle('stale', isStale);
  const wanted = rows(state, age);
  while (list.children.length < wanted.length) {
    const box = document.createElement('div'), value = document.createElement('dd');
    value.append(document.createElement('span'), document.createElement('small'));
    box.append(document.createElement('dt'), value);
    list.append(box);
  }
  while (list.children.length > wanted.length) list.lastChild.remove();
  wanted.forEach(([name, value, more, fresh], n) => {
    const box = list.children[n];
    box.toggleAttribute('data-fresh', Boolean(fresh));
    box.firstChild.textContent = name;
    box.lastChild.firstChild.textContent = value;
    box.lastChild.lastChild.textContent = more;
  });
}
