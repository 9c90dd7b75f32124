// The chart's axis and, over all that is drawn, the cursor with what is to come.

import { css, ticks } from "./format.js";

export const AXIS = 20;
const DISTANCE = 90; // pixels between two labels, at least

// `x` tells where a time is; bars begin at `left`.
export function drawAxis(context, [from, to], { x, left, width, height }) {
  context.strokeStyle = css("--line");
  context.fillStyle = css("--faint");
  context.textAlign = "center";
  for (const { time, label } of ticks(from, to, (width - left) / DISTANCE)) {
    const place = x(time);
    context.beginPath();
    context.moveTo(place, AXIS - 4);
    context.lineTo(place, height);
    context.stroke();
    if (place > left) context.fillText(label, Math.min(place, width - context.measureText(label).width / 2 - 2), AXIS / 2);
  }
}

// `x`: where it is; what is behind it was not yet so.
export function drawCursor(context, x, { left, width, height }) {
  const veiled = Math.max(x, left);
  context.fillStyle = css("--paper");
  context.globalAlpha = 0.45;
  if (veiled < width) context.fillRect(veiled, AXIS, width - veiled, height - AXIS);
  context.globalAlpha = 1;
  if (x < left - 1 || x > width) return;
  context.strokeStyle = css("--mark");
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x, AXIS - 5); // below the labels
  context.lineTo(x, height);
  context.stroke();
  context.lineWidth = 1;
}
