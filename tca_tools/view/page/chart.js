// The Gantt chart: what every resource did when. Bars too narrow to see are drawn as one; what is out of sight costs nothing.

import { AXIS, drawAxis, drawCursor } from "./axis.js";
import { clipped, css, prepared } from "./dom.js";
import { ScrollBar } from "./scroll.js";
import { BETWEEN, LANE, NAMED, THIN, drawCurve, firstWith, inOrder, placed } from "./rows.js";
import { RESOLVED, wasHandled } from "./store.js";
import { spanWords } from "./words.js";

const NARROW = 1.5, STRIP = 3; // pixels; the second, of the mark of what ran ahead of its state
const ROOM = 0.01; // of the time that is seen, beside it
const LEAST = 1, LEAST_DONE = 1e-3; // seconds that are seen if the reader does not zoom; the second, of messages of a run that has ended
const BEFORE = 0.3; // where in the chart the bar of a chosen message begins that was out of sight
const AHEAD = 0.1; // where in the chart the cursor goes on that has run out of it

export class Chart {
  constructor(store, { choose, setTime }) {
    this.store = store;
    this.choose = choose;
    this.setTime = setTime;
    this.canvas = document.getElementById("chart");
    this.hint = document.getElementById("hint");
    this.time = 0;
    this.chosen = null;
    this.from = null; // the window in time; null: from the first message on, to the end
    this.to = null;
    this.last = null; // so many seconds before the moment that is shown are seen; null: the window
    this.stretch = document.getElementById("last");
    this.stretch.addEventListener("change", () => this.showLast(Number(this.stretch.value) || null));
    this.scroll = 0;
    this.held = null; // where the reader holds the chart
    this.labels = 120;
    this.layout = [];
    this.bar = new ScrollBar(this.canvas, (scroll) => {
      if (Math.abs(scroll - this.scroll) <= 1) return;
      this.scroll = scroll;
      this.draw();
    });
    this.#listen();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  show(time) {
    const [from, to] = this.window, wasSeen = this.time >= from && this.time <= to;
    this.time = time;
    if (wasSeen && time > to) this.#moveTo(time, AHEAD); // who has panned away from the cursor is left alone
    this.draw();
    if (!this.hint.hidden) this.#showHint(this.pointer);
  }

  // Bring a moment into sight, if what is seen is a part of the run without it.
  reveal(time) {
    if (this.last !== null) return;
    const [from, to] = this.window;
    if (this.to === null && time > to && time < this.store.end) this.to = this.#latest;
    else if (time < from || time > to) this.#moveTo(time, 0.5);
  }

  // What is seen is as long as before, with a moment at a share of it; nothing beyond the end of a run that has ended.
  #moveTo(time, share) {
    if (this.to === null || this.held) return;
    const [from, to] = this.window, wide = to - from, { isLive } = this.store;
    const first = time - wide * share, last = this.#latest - wide;
    this.from = Math.max(isLive ? first : Math.min(first, last), this.#earliest);
    this.to = this.from + wide;
  }

  // From the first message to the last thing that happened; if that is what is seen, all of the run.
  showAll() {
    const isSeen = this.last === null && this.from === null && this.to === null;
    this.last = null;
    this.from = isSeen ? this.#earliest : null;
    this.to = isSeen && !this.store.isLive ? this.#latest : null;
    this.draw();
  }

  // Only so many seconds before the moment that is shown, which the chart then follows; null: all.
  showLast(seconds) {
    this.from = this.to = null;
    this.last = seconds;
    this.draw();
  }

  // The reader moves the window himself: it stands where it stood.
  #take() {
    if (this.last === null) return;
    [this.from, this.to] = this.window;
    this.last = null;
  }

  // Another message is chosen: the bar that tells of it at a time is brought into sight.
  follow(message, time) {
    this.chosen = message;
    const of = this.store.spans.filter((span) => span.message === message && span.lanes);
    const span = of.findLast(({ kind, start }) => kind === "handling" && start <= time) ?? of.findLast(({ start }) => start <= time) ?? of[0];
    const [from, to] = this.window;
    if (span && (span.end < from || span.start > to)) {
      this.#take();
      this.#moveTo(span.start, BEFORE);
    }
    this.draw();
    const place = span && this.layout.find(({ row }) => row === this.store.rows[span.row]), { height } = this;
    if (!place || (place.top >= AXIS && Math.min(place.bottom, place.top + LANE) <= height)) return;
    this.scroll += place.top - height / 2;
    this.draw();
  }

  get window() {
    const [from, to] = this.#all;
    if (this.last === null) return [this.from ?? from, this.to ?? to];
    const begin = Math.max(Math.min(this.time, this.store.end) - this.last, from);
    return [begin, begin + this.last];
  }

  // The window of a reader who does not zoom.
  get #all() {
    const { start, first, lastly, isLive, goesOn } = this.store, from = first > this.store.end ? start : Math.max(first, start);
    const end = isLive || goesOn || lastly < from ? this.store.end : lastly; // who is just connected makes it no longer (as in gantt/window.py)
    const room = Math.max((end - from) * ROOM, 1e-6);
    return [Math.max(from - room, this.#earliest), Math.max(end + room, from + this.#least)];
  }

  get #least() { return this.store.isLive || this.store.first > this.store.end ? LEAST : LEAST_DONE; }

  get #earliest() {
    const { start, end } = this.store;
    return start - Math.max((end - start) * ROOM, 1e-6);
  }

  get #latest() {
    const { start, end } = this.store;
    return end + Math.max((end - start) * ROOM, 1e-6);
  }

  #x(time) {
    const [from, to] = this.window;
    return this.labels + (Math.min(time, this.store.end + 1e9) - from) / (to - from) * (this.width - this.labels);
  }

  #timeAt(x) {
    const [from, to] = this.window;
    return from + (x - this.labels) / (this.width - this.labels) * (to - from);
  }

  // --- drawing -----------------------------------------------------------------------------------------------------

  draw() {
    const { context, width, height } = prepared(this.canvas);
    Object.assign(this, { context, width, height, looks: { lift: css("--lift"), weak: Number(css("--weak")), held: css("--handled") } });
    if (!this.store.head || width < 50) return;
    const seen = String(this.last ?? (this.from === null && this.to === null ? "" : "part"));
    if (this.stretch.value !== seen) this.stretch.value = seen;
    context.font = "12px system-ui, Helvetica, Arial, sans-serif";
    context.textBaseline = "middle";
    this.#lay();
    const place = { left: this.labels, width, height };
    drawAxis(context, this.window, { ...place, x: (time) => this.#x(time) });
    this.toCome = []; // what is drawn when that is paler
    this.#within(() => this.layout.forEach((row) => row.bottom > AXIS && row.top < height && this.#drawRow(row)));
    drawCursor(context, this.#x(Math.min(this.time, this.store.end)), place);
    this.#within(() => this.toCome.forEach((draw) => draw()));
    this.bar.show(this.tall, height - AXIS - 6, this.scroll, this.layout.filter((place) => place.top + LANE > height).length);
  }

  // Draws below the axis only.
  #within(draw) {
    const { context, width, height } = this;
    context.save();
    context.beginPath();
    context.rect(0, AXIS, width, height - AXIS);
    context.clip();
    draw();
    context.restore();
  }

  // Where each row stands.
  #lay() {
    const rows = inOrder(this.store.rows), widths = rows.map((row) => this.context.measureText(row.label).width);
    this.labels = Math.min(Math.max(60, ...widths) + 16, this.width * 0.3);
    const [from, to] = this.#all;
    const { layout, tall } = placed(rows, { scale: (this.width - this.labels) / (to - from), now: this.store.end });
    Object.assign(this, { layout, tall });
    this.scroll = Math.min(Math.max(this.scroll, 0), Math.max(tall - (this.height - AXIS - 6), 0));
    for (const place of this.layout) {
      place.top += AXIS + 4 - this.scroll;
      place.bottom += AXIS + 4 - this.scroll;
    }
  }

  #drawRow({ row, top, lanes, thin, held, step, curve, bottom }) {
    const { context } = this;
    context.fillStyle = css("--panel");
    for (const span of row.connected) {
      const x = Math.max(this.#x(span.start), this.labels);
      context.fillRect(x, top, Math.max(Math.min(this.#x(span.end), this.width) - x, 0), bottom - top);
    }
    let y = top;
    for (const lane of row.held.lists.slice(0, held)) {
      this.#drawLane(lane, y, THIN - 2, (span, x, w) => this.#drawHeld(x, w, y));
      y += THIN;
    }
    for (const lane of row.handled.lists.slice(0, lanes)) {
      this.#drawLane(lane, y, LANE - 2, (span, x, w) => this.#drawBar(span, x, w, y));
      y += LANE;
    }
    y = top + held * THIN + lanes * LANE;
    for (const lane of row.queued.lists.slice(0, thin)) {
      this.#drawLane(lane, y, step - 2, (span, x, w) => this.#drawQueued(span, x, w, y, step - 2));
      y += step;
    }
    if (curve) this.#drawCurve(row, y, curve - 2);
    for (const span of row.failed) {
      const x = this.#x(span.end);
      if (x >= this.labels && x <= this.width && x - this.#x(span.start) < 4) this.#mark(x, top, this.#tintOf(span));
    }
    const where = [top + held * THIN, lanes, thin, step];
    for (const change of row.changes) this.#drawMoment(change, css("--ink"), ...where);
    for (const failure of row.raised) this.#drawMoment(failure, css(wasHandled(failure, this.time) ? "--handled" : "--bad"), ...where);
    context.fillStyle = css("--paper");
    context.fillRect(0, top - BETWEEN / 2, this.labels - 1, bottom - top + BETWEEN);
    context.fillStyle = css("--ink");
    context.textAlign = "right";
    context.fillText(clipped(context, row.label, this.labels - 14), this.labels - 8, top + (held * THIN) + (lanes ? LANE : step) / 2 - 1);
  }

  // The spans of a lane that are in sight; those of one pixel column count as one.
  #drawLane(lane, y, tall, draw) {
    const [from, to] = this.window;
    let place = firstWith(lane, (span) => span.end > from);
    while (place < lane.length && lane[place].start < to) {
      const span = lane[place], x = Math.max(this.#x(span.start), this.labels), end = Math.min(this.#x(span.end), this.width);
      if (end - x >= NARROW) {
        draw(span, x, end - x);
        place++;
      } else {
        const next = this.#timeAt(x + NARROW);
        const after = Math.max(place + 1, firstWith(lane, (other) => other.end > next, place + 1));
        const busy = after > place + 1 ? share(lane, place, after, next - this.#timeAt(x)) : 0.75;
        this.context.fillStyle = span.kind === "held" ? this.looks.held : this.store.colour(span.name);
        this.context.globalAlpha = 0.2 + 0.8 * busy; // the fuller, the more was going on
        this.context.fillRect(x, y, NARROW, tall);
        this.context.globalAlpha = 1;
        place = after;
      }
    }
  }

  #drawBar(span, x, width, y) {
    const { context } = this, tall = LANE - 2, open = span.end === Infinity;
    const end = Math.min(x + width, open ? this.#x(this.store.end) : Infinity), wide = Math.max(end - x, NARROW);
    context.fillStyle = this.store.colour(span.name);
    context.globalAlpha = span.kind === "waiting" ? 0.3 : 1;
    context.fillRect(x, y, wide, tall);
    context.globalAlpha = 1;
    for (const wait of span.waits) {
      const left = Math.max(this.#x(wait.start), x), right = Math.min(this.#x(Math.min(wait.end, this.store.end)), x + wide);
      context.fillStyle = "rgb(255 255 255 / 62%)";
      if (right > left) context.fillRect(left, y + 1, right - left, tall - 2);
    }
    const ahead = this.store.aheadOf(span);
    if (ahead) this.#drawAhead(x, Math.min(this.#x(Math.min(ahead.until, this.store.end)), x + wide), y, ahead.isWasted);
    const isChosen = span.message && span.message === this.chosen, inset = isChosen ? 1 : 0; // two frames are both seen
    const left = span.end > this.time ? Math.max(this.#x(this.time), x) : x; // before a failure is known, only what is to come has its frame
    if (span.outcome === "failed") this.#outline(left + inset, y + inset, x + wide - left - 2 * inset, tall - 2 * inset, this.#tintOf(span), 2);
    if (span.outcome === "killed" && wide > 6) {
      context.fillStyle = css("--ink"); // a dark end
      context.fillRect(x + wide - 3, y, 3, tall);
    }
    if (isChosen) this.#outline(x - 1, y - 1, wide + 2, tall + 2, css("--ink"), 2);
    if (wide > 34) this.#drawName(span, x, y, wide, tall);
  }

  // A blue strip over what ran ahead of its state, of dashes if for nothing.
  #drawAhead(x, end, y, isWasted) {
    const { context } = this;
    context.fillStyle = "#ffffff";
    context.fillRect(x, y, end - x, STRIP + 1);
    context.fillStyle = "#7ab4f0";
    for (let left = x; left < end; left += isWasted ? 2 * STRIP : Infinity) {
      context.fillRect(left, y, Math.min(isWasted ? STRIP : Infinity, end - left), STRIP);
    }
  }

  // On what is to come in dark letters, and when that has become paler.
  #drawName(span, x, y, wide, tall) {
    const { context } = this, begin = Math.max(x, this.labels) + 4, now = this.#x(Math.min(this.time, this.store.end));
    const words = clipped(context, span.kind === "waiting" ? `waits for ${span.name}` : span.name, x + wide - begin - 2);
    const last = begin + context.measureText(words).width, write = (left, right, colour) => {
      context.save();
      context.beginPath();
      context.rect(left, y, right - left, tall);
      context.clip();
      context.fillStyle = colour;
      context.textAlign = "left";
      context.fillText(words, begin, y + tall / 2 + 0.5);
      context.restore();
    };
    const ink = css("--ink"), known = span.kind === "waiting" ? ink : isLight(span, this.#timeAt(begin), this.#timeAt(last)) ? "#111" : "#fff";
    if (now > begin) write(x, Math.min(x + wide, now), known);
    if (last > now) this.toCome.push(() => write(Math.max(x, now), x + wide, ink));
  }

  // The moment at which a failure was raised beside the handler, or of a client's request: a stroke across the bar, and a
  // mark on it.
  #drawMoment({ time, span }, tint, top, lanes, thin, step) {
    const { context } = this, x = this.#x(time), isQueued = span.kind === "queued", tall = isQueued ? step - 2 : LANE - 2;
    if (x < this.labels || x > this.width) return;
    const y = isQueued ? top + lanes * LANE + Math.min(span.lane, thin - 1) * step : top + Math.min(span.lane, lanes - 1) * LANE;
    context.fillStyle = css("--paper");
    context.fillRect(x - 2, y, 4, tall); // seen in bars of its own colour, too
    context.fillStyle = tint;
    context.fillRect(x - 1, y, 2, tall);
    this.#mark(x, y, context.fillStyle);
  }

  // What waits: weaker than what is handled; on dark paper lighter, too, or it would not be seen.
  #drawQueued(span, x, width, y, tall) {
    const { context } = this, wide = Math.min(x + width, this.#x(Math.min(span.end, this.store.end))) - x;
    context.fillStyle = `color-mix(in srgb, white ${this.looks.lift}, ${this.store.colour(span.name)})`;
    context.globalAlpha = this.looks.weak;
    context.fillRect(x, y, Math.max(wide, NARROW), tall);
    context.globalAlpha = 1;
    context.fillRect(x, y, 1.5, tall);
    if (span.message === this.chosen) this.#outline(x, y, wide, tall, css("--ink"), 1.5);
    if (tall < NAMED - 2 || wide < 34) return;
    context.save();
    context.font = "11px system-ui, Helvetica, Arial, sans-serif";
    context.fillStyle = css("--ink");
    context.textAlign = "left";
    const left = Math.max(x, this.labels) + 4;
    context.fillText(clipped(context, span.message ? `${span.name} ${span.message}` : span.name, x + wide - left - 2), left, y + tall / 2 + 0.5);
    context.restore();
  }

  // How many wait, behind those that are drawn.
  #drawCurve(row, y, tall) {
    const { store: { end } } = this, [from, to] = this.window, left = Math.floor(this.labels);
    const wide = Math.max(Math.ceil(Math.min(this.#x(end), this.width) - left), 0);
    const times = Array.from({ length: wide + 1 }, (_, x) => Math.min(Math.max(this.#timeAt(left + x), from), to, end));
    const looks = { ink: css("--ink"), paper: css("--paper"), how: row.suspends ? "suspended" : "queued" };
    drawCurve(this.context, row.queued.peaks(times), { left, y, tall, ...looks });
  }

  #drawHeld(x, width, y) {
    this.context.fillStyle = this.looks.held;
    this.context.fillRect(x, y, Math.max(Math.min(x + width, this.#x(this.store.end)) - x, NARROW), THIN - 3);
  }

  // Red, or amber if the run had gone on after that failure.
  #tintOf(span) {
    const task = this.store.byId.get(span.message);
    if (task?.states?.at(-1) === RESOLVED && this.store.stateAt(task, this.time) === RESOLVED) return css("--resolved");
    return css(wasHandled(span.failure, this.time) ? "--handled" : "--bad");
  }

  #outline(x, y, width, tall, style, thick) {
    this.context.strokeStyle = style;
    this.context.lineWidth = thick;
    this.context.strokeRect(x + 0.5, y + 0.5, Math.max(width - 1, 1), tall - 1);
    this.context.lineWidth = 1;
  }

  #mark(x, y, tint) {
    this.context.fillStyle = tint;
    this.context.beginPath();
    this.context.moveTo(x - 4, y - 5);
    this.context.lineTo(x + 4, y - 5);
    this.context.lineTo(x, y + 1);
    this.context.fill();
  }

  // --- the mouse ---------------------------------------------------------------------------------------------------

  // The span under the mouse, if there is one.
  at(x, y) {
    if (x < this.labels) return null;
    for (const { row, top, bottom, lanes, held, thin, step } of this.layout) {
      if (y < top || y > bottom) continue;
      const inside = y - top - held * THIN;
      const lane = inside < 0 ? row.held.lists[Math.floor((y - top) / THIN)]
        : inside < lanes * LANE ? row.handled.lists[Math.floor(inside / LANE)]
          : row.queued.lists.slice(0, thin)[Math.floor((inside - lanes * LANE) / step)];
      const time = this.#timeAt(x), near = this.#timeAt(x + 3) - time;
      const span = lane?.[firstWith(lane, (other) => other.end >= time - near)];
      if (!span || span.start > time + near) return null;
      const wait = span.waits.find((one) => one.start <= time && one.end >= time);
      const isThere = (one) => one.span === span && Math.abs(one.time - time) <= 1.5 * near;
      return { span, wait, row, failure: row.raised.find(isThere), change: row.changes.find(isThere) };
    }
    return null;
  }

  #listen() {
    const { canvas } = this;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (event.shiftKey || event.offsetX < this.labels) this.scroll += event.deltaY;
      else this.#zoom(event.offsetX, Math.exp(event.deltaY * 0.0015));
      this.draw();
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      this.held = { x: event.offsetX, y: event.offsetY, scroll: this.scroll, window: this.window, moved: false };
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.held) this.#pan(event, this.held);
      else this.#showHint(event);
    });
    canvas.addEventListener("pointerup", (event) => {
      const { held } = this;
      this.held = null;
      if (held && !held.moved) this.#click(event);
    });
    canvas.addEventListener("pointercancel", () => { this.held = null; });
    canvas.addEventListener("pointerleave", () => { this.hint.hidden = true; });
    canvas.addEventListener("dblclick", () => this.showAll());
  }

  #click(event) {
    const found = event.offsetY > AXIS && this.at(event.offsetX, event.offsetY);
    if (found && found.span.message) this.choose(found.wait ? found.wait.message : found.span.message);
    else if (event.offsetX > this.labels) this.setTime(this.#timeAt(event.offsetX), { keepUp: true });
  }

  #zoom(x, factor) {
    this.#take();
    const [from, to] = this.window, centre = this.#timeAt(x);
    const least = 1e-6, most = Math.max((this.store.end - this.#earliest) * 1.05, this.#least) + 1e-3;
    const wide = Math.min(Math.max((to - from) * factor, least), most), share = (centre - from) / (to - from);
    this.from = centre - share * wide;
    this.to = this.from + wide;
    if (wide >= most) {
      this.from = this.#earliest;
      this.to = null;
    }
  }

  #pan(event, held) {
    const dx = event.offsetX - held.x, dy = event.offsetY - held.y;
    if (Math.abs(dx) + Math.abs(dy) > 3) held.moved = true;
    if (!held.moved) return;
    this.#take();
    const [from, to] = held.window, shift = dx / (this.width - this.labels) * (to - from);
    if (from > this.#earliest || this.to !== null) { this.from = from - shift; this.to = to - shift; }
    this.scroll = held.scroll - dy;
    this.hint.hidden = true;
    this.draw();
  }

  #showHint({ offsetX, offsetY }) {
    this.pointer = { offsetX, offsetY };
    const found = this.at(offsetX, offsetY);
    this.hint.hidden = !found;
    if (!found) return;
    this.hint.textContent = spanWords(found, this.store, this.time);
    const left = Math.min(offsetX + 14, this.width - Math.min(this.hint.offsetWidth, this.width) - 4);
    this.hint.style.left = `${Math.max(left, 0)}px`;
    this.hint.style.top = `${Math.min(offsetY + 16, this.height - 26)}px`;
  }
}

// Which part of some seconds the spans of a lane between two places take.
function share(lane, from, to, seconds) {
  const sums = (lane.sums ??= [0]); // of the lengths of all before each place
  while (sums.length <= to) {
    const span = lane[sums.length - 1];
    if (span.end === Infinity) return 1;
    sums.push(sums[sums.length - 1] + span.end - span.start);
  }
  return Math.min((sums[to] - sums[from]) / seconds, 1);
}

// Whether a bar is light, since its handler waits, in more than half of a stretch of time.
function isLight({ kind, waits }, from, to) {
  let light = 0;
  for (const wait of waits) light += Math.max(Math.min(wait.end, to) - Math.max(wait.start, from), 0);
  return kind === "waiting" || light > (to - from) / 2;
}
