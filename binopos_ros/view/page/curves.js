// Curves of the last two minutes.

const SECONDS = 120;
const BAND_95 = 1.96;
// What a point of a curve is made of: see Screen.curves.
const CURVES = [
  {name: 'x', unit: 'm', value: 1, deviation: 4, digits: 4, colour: '--x'},
  {name: 'y', unit: 'm', value: 2, deviation: 5, digits: 4, colour: '--y'},
  {name: 'z', unit: 'm', value: 3, deviation: 6, digits: 4, colour: '--z'},
  {name: 'latency', unit: 'ms', value: 7, scale: 1000, digits: 0, colour: '--ink'},
  {name: 'rate', unit: 'poses/s', value: 8, digits: 1, colour: '--ink'},
];

export class Curves {
  constructor(section) {
    this.points = [];
    this.charts = CURVES.map((curve) => {
      const figure = document.createElement('figure');
      const canvas = document.createElement('canvas');
      const caption = document.createElement('figcaption');
      canvas.setAttribute('role', 'img');
      canvas.setAttribute('aria-label', `Curve of ${curve.name}`);
      figure.append(caption, canvas);
      section.append(figure);
      return {...curve, canvas, caption};
    });
  }

  clear() { this.points = []; }

  add(points) {
    this.points.push(...points);
    const newest = this.points.at(-1)?.[0] ?? 0;
    while (this.points.length && this.points[0][0] < newest - SECONDS) this.points.shift();
  }

  draw() {
    for (const chart of this.charts) this.drawChart(chart);
  }

  drawChart({canvas, caption, name, unit, value, deviation, digits, colour, scale = 1}) {
    const pen = fitted(canvas), {width, height} = canvas;
    const known = this.points.filter((point) => point[value] !== null);
    const band = deviation ? ` ± ${BAND_95} deviations` : '';
    if (!known.length) {
      caption.textContent = `${name} (${unit}): not known`;
      return;
    }
    const newest = known.at(-1)[0];
    const spread = (point) => (deviation ? BAND_95 * point[deviation] : 0);
    let low = Infinity, high = -Infinity;
    for (const point of known) {
      low = Math.min(low, (point[value] - spread(point)) * scale);
      high = Math.max(high, (point[value] + spread(point)) * scale);
    }
    const least = 2 * 10 ** -digits;
    const middle = (low + high) / 2, half = Math.max((high - low) / 2, least) * 1.05;
    low = middle - half; high = middle + half;
    caption.textContent = `${name}${band}, ${unit}: ${(known.at(-1)[value] * scale).toFixed(digits)} now, `
      + `drawn from ${low.toFixed(digits)} to ${high.toFixed(digits)}`;
    const at = (point, y) => [
      width * (1 - (newest - point[0]) / SECONDS),
      height * (1 - (y * scale - low) / (high - low)),
    ];
    const style = getComputedStyle(document.documentElement);
    pen.strokeStyle = style.getPropertyValue('--line');
    pen.lineWidth = 1;
    for (let back = 0; back <= SECONDS; back += 30) {
      const x = width * (1 - back / SECONDS);
      pen.beginPath(); pen.moveTo(x, 0); pen.lineTo(x, height); pen.stroke();
    }
    const ink = style.getPropertyValue(colour);
    for (const run of unbroken(known)) {
      if (deviation) {
        pen.beginPath();
        run.forEach((point) => pen.lineTo(...at(point, point[value] + spread(point))));
        run.toReversed().forEach((point) => pen.lineTo(...at(point, point[value] - spread(point))));
        pen.globalAlpha = 0.3; pen.fillStyle = ink; pen.fill(); pen.globalAlpha = 1;
      }
      pen.beginPath();
      run.forEach((point) => pen.lineTo(...at(point, point[value])));
      pen.strokeStyle = ink; pen.lineWidth = 1.8 * devicePixelRatio; pen.stroke();
    }
    pen.fillStyle = style.getPropertyValue('--soft');
    pen.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    pen.textAlign = 'left';
    pen.fillText('2 min ago', 4, height - 4);
    pen.textAlign = 'right';
    pen.fillText('now', width - 4, height - 4);
  }
}

// Runs of points without a gap: a line across one would show what nobody measured.
function unbroken(points) {
  const runs = [];
  points.forEach((point, index) => {
    if (!index || point[0] - points[index - 1][0] > 1) runs.push([]);
    runs.at(-1).push(point);
  });
  return runs;
}

// The pen of a canvas whose pixels are those of the screen; the canvas is empty.
export function fitted(canvas) {
  const width = Math.round(canvas.clientWidth * devicePixelRatio);
  const height = Math.round(canvas.clientHeight * devicePixelRatio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, {width, height});
  const pen = canvas.getContext('2d');
  pen.clearRect(0, 0, width, height);
  return pen;
}
