// The chart's axis, and the cursor with a veil over the future.

import { css } from "./dom.js";

export const AXIS = 20;
const DISTANCE = 90; // pixels between two labels, at least
const STEPS = [60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 28800, 43200, 86400];

// `x` returns the place of a time; bars start at `left`.
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

// `x`: its place. Everything right of it is in the future.
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

// Round times between start and end, about `most` of them, with labels.
export function ticks(start, end, most) {
  const shortest = (end - start) / Math.max(most, 1);
  if (!(shortest > 0)) return [];
  let step = STEPS.find((one) => one >= shortest) ?? 86400 * Math.ceil(shortest / 86400);
  if (shortest <= 30) {
    const power = 10 ** Math.floor(Math.log10(shortest));
    step = power * ([1, 2, 5, 10].find((factor) => factor * power >= shortest * (1 - 1e-9)) ?? 10);
    if (step === 50) step = 30;
  }
  const digits = step < 1 ? Math.min(9, Math.ceil(-Math.log10(step) - 1e-9)) : 0, found = [];
  for (let number = Math.ceil(start / step - 1e-9); number * step <= end + step * 1e-9; number++) found.push({ time: number * step });
  const isLong = found.length > 0 && found.at(-1).time >= 600;
  return found.map(({ time }) => ({ time, label: onAxis(time, digits, isLong) }));
}

// Labels with the precision that the axis needs; all labels of an axis are in seconds, or in minutes.
function onAxis(time, digits, isLong) {
  if (!isLong) return `${time.toFixed(digits)} s`;
  const minutes = Math.floor(Number(time.toFixed(digits)) / 60), hours = Math.floor(minutes / 60);
  const rest = Math.max(time - minutes * 60, 0).toFixed(digits).padStart(digits ? digits + 3 : 2, "0");
  return hours ? `${hours}:${String(minutes % 60).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}
