// Plan and side view, to scale: the cameras, the surface, the target, where it was and how sure that is.

import {fitted} from './curves.js';
import {ellipse} from './pictures.js';

const DEVIATIONS_95 = 2.7955; // of three coordinates
const LENGTHS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];

// Which coordinate goes right and which up, with its sign. In the rig's frame z is ahead and y down; in a fixed
// one z is up.
const VIEWS = {
  rig: {plan: [[0, 1], [2, 1], 'from above: x to the right, z ahead'],
    side: [[2, 1], [1, -1], 'from the side: z ahead, y down']},
  fixed: {plan: [[0, 1], [1, 1], 'from above: x to the right, y up the page'],
    side: [[0, 1], [2, 1], 'from the side: x to the right, z up']},
};

export class Space {
  constructor(section) {
    this.views = [...section.querySelectorAll('canvas')].map((canvas) => ({
      canvas, caption: canvas.nextElementSibling, name: canvas.dataset.view,
    }));
  }

  draw(state, points) {
    if (!state?.pose) return;
    const isRig = /optical|^$/.test(state.pose.frame);
    const baseline = Math.max(...Object.values(state.cameras).map((each) => each.baseline), 0);
    const cameras = isRig ? [[0, 0, 0], ...(baseline ? [[baseline, 0, 0]] : [])] : [];
    for (const view of this.views) this.drawView(view, VIEWS[isRig ? 'rig' : 'fixed'][view.name], state, points, cameras);
  }

  drawView({canvas, caption}, [[right, rightSign], [up, upSign], words], state, points, cameras) {
    const pen = fitted(canvas), {width, height} = canvas;
    const style = getComputedStyle(document.documentElement), ratio = devicePixelRatio;
    const flat = (place) => [rightSign * place[right], upSign * place[up]];
    const {position, covariance, frame} = state.pose;
    const trail = points.map((point) => flat(point.slice(1, 4)));
    const all = [...trail, flat(position), ...cameras.map(flat)];
    const edges = [0, 1].map((axis) => [Math.min(...all.map((p) => p[axis])), Math.max(...all.map((p) => p[axis]))]);
    const spans = edges.map(([low, high]) => Math.max(high - low, 0.05));
    const scale = 0.8 * Math.min(width / spans[0], height / spans[1]);
    const middle = edges.map(([low, high]) => (low + high) / 2);
    const at = ([x, y]) => [width / 2 + (x - middle[0]) * scale, height / 2 - (y - middle[1]) * scale];

    if (state.surface && cameras.length) this.drawSurface(pen, state.surface, [right, rightSign], [up, upSign], at, width, style);
    pen.strokeStyle = style.getPropertyValue('--soft');
    pen.lineWidth = 1.5 * ratio;
    pen.beginPath();
    trail.forEach((place) => pen.lineTo(...at(place)));
    pen.stroke();
    pen.fillStyle = style.getPropertyValue('--ink');
    for (const camera of cameras) {
      const [x, y] = at(flat(camera));
      pen.fillRect(x - 5 * ratio, y - 4 * ratio, 10 * ratio, 8 * ratio);
    }
    const [x, y] = at(flat(position));
    const element = (a, b) => covariance[3 * a + b];
    pen.strokeStyle = pen.fillStyle = style.getPropertyValue('--mark');
    pen.beginPath();
    ellipse(pen, x, y, [element(right, right), -rightSign * upSign * element(right, up), element(up, up)],
      DEVIATIONS_95 * scale);
    pen.stroke();
    pen.beginPath(); pen.arc(x, y, 3.5 * ratio, 0, 2 * Math.PI); pen.fill();
    this.drawScale(pen, scale, height, ratio, style);
    caption.textContent = `${words} (${frame || 'rig'})`;
  }

  drawSurface(pen, {normal, distance}, [right, rightSign], [up, upSign], at, width, style) {
    // Where the plane cuts the plane of the page.
    const n = [normal[right] * rightSign, normal[up] * upSign], length = Math.hypot(...n);
    if (length < 0.05) return;
    const foot = n.map((each) => each * distance / length ** 2), along = [-n[1] / length, n[0] / length];
    pen.strokeStyle = style.getPropertyValue('--note');
    pen.beginPath();
    pen.moveTo(...at([foot[0] - 100 * along[0], foot[1] - 100 * along[1]]));
    pen.lineTo(...at([foot[0] + 100 * along[0], foot[1] + 100 * along[1]]));
    pen.stroke();
  }

  drawScale(pen, scale, height, ratio, style) {
    const length = LENGTHS.find((each) => each * scale > 50 * ratio) ?? LENGTHS.at(-1);
    const told = length < 1 ? `${length * 1000} mm` : `${length} m`;
    pen.fillStyle = pen.strokeStyle = style.getPropertyValue('--ink');
    pen.lineWidth = 2 * ratio;
    pen.beginPath();
    pen.moveTo(8 * ratio, height - 8 * ratio); pen.lineTo(8 * ratio + length * scale, height - 8 * ratio);
    pen.stroke();
    pen.font = `${12 * ratio}px system-ui, sans-serif`;
    pen.fillText(told, 8 * ratio, height - 14 * ratio);
  }
}
