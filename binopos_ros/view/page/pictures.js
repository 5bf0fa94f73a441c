// The two pictures, each with what the topics say of its own instant drawn over it.

import {STALE_MS} from './link.js';

// A picture waits this long for what was found in it; the detector takes some ten milliseconds.
const PATIENCE_MS = 250;
const KEPT = 32;
const MAGNIFIED = 100;
const DEVIATIONS_95 = 2.4477; // of two coordinates

export class Eye {
  constructor(figure) {
    this.figure = figure;
    this.canvas = figure.querySelector('canvas');
    this.caption = figure.querySelector('figcaption');
    this.marks = new Map();
    this.waiting = [];
    this.shownAt = -Infinity;
    this.refusal = '';
    this.shown = null;
  }

  async add({stamp, drawn, jpeg}) {
    let bitmap;
    try {
      bitmap = await createImageBitmap(jpeg, {imageOrientation: 'none'});
    } catch {
      this.refusal = 'the picture is damaged';
      return;
    }
    // What the detector has drawn itself waits for nothing.
    this.waiting.push({stamp, bitmap, drawn, came: drawn ? -Infinity : performance.now()});
    while (this.waiting.length > 8) this.waiting.shift().bitmap.close();
    this.look();
  }

  mark(mark) {
    this.marks.set(mark.stamp, mark);
    if (this.marks.size > KEPT) this.marks.delete(this.marks.keys().next().value);
    this.look();
  }

  // Show the newest picture whose mark is known, or one that has waited for long enough.
  look() {
    const now = performance.now();
    let best = -1;
    this.waiting.forEach((each, index) => {
      if (this.marks.has(each.stamp) || now - each.came > PATIENCE_MS) best = index;
    });
    if (best >= 0) {
      const gone = this.waiting.splice(0, best + 1);
      const newest = gone.pop();
      gone.forEach((each) => each.bitmap.close());
      this.draw(newest.bitmap, newest.drawn ? null : this.marks.get(newest.stamp));
      this.shownAt = now;
      this.shown = {stamp: newest.stamp, mark: this.marks.get(newest.stamp) ?? null};
      newest.bitmap.close();
    }
  }

  draw(bitmap, mark) {
    const {canvas} = this;
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      canvas.width = bitmap.width;
      canvas.height = bitmap.height;
      canvas.style.aspectRatio = `${bitmap.width} / ${bitmap.height}`;
    }
    const pen = canvas.getContext('2d');
    pen.drawImage(bitmap, 0, 0);
    if (mark) this.drawMark(pen, mark, canvas.width / Math.max(canvas.clientWidth, 1));
  }

  drawMark(pen, mark, unit) {
    // The suite's (0, 0) is the middle of a pixel, the canvas's its corner.
    const u = mark.u + 0.5, v = mark.v + 0.5;
    const colour = getComputedStyle(document.documentElement).getPropertyValue('--mark');
    for (const [width, style] of [[4 * unit, '#000'], [1.8 * unit, colour]]) {
      pen.strokeStyle = style;
      pen.lineWidth = width;
      pen.beginPath();
      pen.ellipse(u, v, mark.diameter / 2, mark.diameter / 2, 0, 0, 2 * Math.PI);
      pen.moveTo(u - 5 * unit, v); pen.lineTo(u + 5 * unit, v);
      pen.moveTo(u, v - 5 * unit); pen.lineTo(u, v + 5 * unit);
      pen.stroke();
      pen.beginPath();
      ellipse(pen, u, v, mark.covariance, MAGNIFIED * DEVIATIONS_95);
      pen.stroke();
    }
  }

  // Under the picture: how often and how old, and what was found.
  tell(rate, refusal, isCut) {
    this.look();
    const age = performance.now() - this.shownAt;
    const stale = isCut || age > STALE_MS;
    this.figure.classList.toggle('stale', stale);
    const side = this.figure.dataset.side;
    if (this.shown === null) {
      this.caption.textContent = `${side}: no picture yet`;
    } else if (stale) {
      this.caption.textContent = `${side}: the picture is ${(age / 1000).toFixed(1)} s old`;
    } else {
      const {mark} = this.shown;
      const [a, , c] = mark ? mark.covariance : [];
      const found = side === 'board' ? 'what binopos calibrate finds, and where to hold the board next' : mark
        ? `target ${mark.diameter.toFixed(1)} px wide, centre ± ${Math.sqrt(Math.max(a, c)).toFixed(3)} px `
          + `(95 % ellipse drawn ${MAGNIFIED} × larger)`
        : `no target${refusal ? `: ${refusal}` : ''}`;
      this.caption.textContent = `${side}: ${rate.toFixed(0)} pictures/s; ${this.refusal || found}`;
    }
    this.refusal = '';
  }
}

// Add the ellipse of a covariance (aa, ab, bb), so many deviations wide, to the path.
export function ellipse(pen, x, y, [aa, ab, bb], deviations) {
  const middle = (aa + bb) / 2, apart = Math.hypot((aa - bb) / 2, ab);
  const long = Math.sqrt(Math.max(middle + apart, 0)), short = Math.sqrt(Math.max(middle - apart, 0));
  pen.ellipse(x, y, long * deviations, short * deviations, Math.atan2(2 * ab, aa - bb) / 2, 0, 2 * Math.PI);
}
