// The Gantt chart: the spans of each resource. Only bars in sight are drawn, and bars too narrow to see are merged.

import { AXIS, drawAxis, drawCursor } from "./axis.js";
import { clipped, css, prepared } from "./dom.js";
import { ScrollBar } from "./scroll.js";
import { BETWEEN, LANE, NAMED, THIN, drawCurve, firstWith, inOrder, placed } from "./rows.js";
import { RESOLVED, wasHandled } from "./store.js";
import { seconds, spanWords } from "./words.js";

const MERGED_BELOW = 1.5, STRIP_HEIGHT = 3; // pixels; STRIP_HEIGHT: of the strip over the bar of a task that ran ahead of its state
const MARGIN = 0.01; // free time at both ends of the window, as a share of it
const SHORTEST = 1, SHORTEST_ENDED = 1e-3; // seconds of the shortest default window; SHORTEST_ENDED: for a run that has ended
const CHOSEN_AT = 0.3; // share of the window before the bar of a chosen message, if it was out of sight
const CURSOR_AT = 0.1; // share of the window before the cursor, when it has left the window

export class Chart {
  constructor(store, { choose, setTime }) {
    this.store = store;
    this.choose = choose;
    this.setTime = setTime;
    this.canvas = document.getElementById("chart");
    this.hint = document.getElementById("hint");
    this.time = 0;
    this.chosen = null;
    this.from = null; // start of the window; null: the first message
    this.to = null; // end of the window; null: the end of the run
    this.lastSeconds = null; // if set, the window is this many seconds before the time shown
    this.lastSelect = document.getElementById("last");
    this.lastSelect.addEventListener("change", () => this.showLast(Number(this.lastSelect.value) || null));
    this.scroll = 0;
    this.drag = null; // the start of the drag that pans the chart
    this.labelWidth = 120;
    this.layout = []; // see `placed` in rows.js
    this.scrollBar = new ScrollBar(this.canvas, (scroll) => {
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
    if (wasSeen && time > to) this.#moveWindow(time, CURSOR_AT); // unless the user has panned away from the cursor
    this.draw();
    if (!this.hint.hidden) this.#showHint(this.pointer);
  }

  // Move the window to a time, if the time is outside it.
  reveal(time) {
    if (this.lastSeconds !== null) return;
    const [from, to] = this.window;
    if (this.to === null && time > to && time < this.store.end) this.to = this.#latest;
    else if (time < from || time > to) this.#moveWindow(time, 0.5);
  }

  // Move the window so that a share of it is before a time. It keeps its length, and does not pass the end of a run that has ended.
  #moveWindow(time, share) {
    if (this.to === null || this.drag) return;
    const [from, to] = this.window, wide = to - from, { isLive } = this.store;
    const first = time - wide * share, last = this.#latest - wide;
    this.from = Math.max(isLive ? first : Math.min(first, last), this.#earliest);
    this.to = this.from + wide;
  }

  // Show the default window; if it is shown already, the whole run.
  zoomOut() {
    const isShown = this.lastSeconds === null && this.from === null && this.to === null;
    this.lastSeconds = null;
    this.from = isShown ? this.#earliest : null;
    this.to = isShown && !this.store.isLive ? this.#latest : null;
    this.draw();
  }

  // Show the given seconds before the time shown, and follow it; null: show the default window.
  showLast(seconds) {
    this.from = this.to = null;
    this.lastSeconds = seconds;
    this.draw();
  }

  // Keep the window in its place: the user moves it from now on.
  #stopFollowing() {
    if (this.lastSeconds === null) return;
    [this.from, this.to] = this.window;
    this.lastSeconds = null;
  }

  // Mark the chosen message, and bring its bar at a time into sight.
  showChosen(message, time) {
    this.chosen = message;
    const bars = this.store.spans.filter((span) => span.message === message && span.lanes);
    const span = bars.findLast(({ kind, start }) => kind === "handling" && start <= time) ?? bars.findLast(({ start }) => start <= time) ?? bars[0];
    const [from, to] = this.window;
    if (span && (span.end < from || span.start > to)) {
      this.#stopFollowing();
      this.#moveWindow(span.start, CHOSEN_AT);
    }
    this.draw();
    const box = span && this.layout.find(({ row }) => row === this.store.rows[span.row]), { height } = this;
    if (!box || (box.top >= AXIS && Math.min(box.bottom, box.top + LANE) <= height)) return;
    this.scroll += box.top - height / 2;
    this.draw();
  }

  // The start and end of the time shown.
  get window() {
    const [from, to] = this.#defaultWindow;
    if (this.lastSeconds === null) return [this.from ?? from, this.to ?? to];
    const begin = Math.max(Math.min(this.time, this.store.end) - this.lastSeconds, from);
    return [begin, begin + this.lastSeconds];
  }

  // The window without zoom: from the first message to the last change.
  get #defaultWindow() {
    const { start, firstMessage, lastChange, isLive, hasOpenSpans } = this.store, from = firstMessage > this.store.end ? start : Math.max(firstMessage, start);
    const end = isLive || hasOpenSpans || lastChange < from ? this.store.end : lastChange; // connections do not extend it (as in gantt/window.py)
    const room = Math.max((end - from) * MARGIN, 1e-6);
    return [Math.max(from - room, this.#earliest), Math.max(end + room, from + this.#shortest)];
  }

  get #shortest() { return this.store.isLive || this.store.firstMessage > this.store.end ? SHORTEST : SHORTEST_ENDED; }

  // The limits of the window: the run, with a margin.
  get #earliest() {
    const { start, end } = this.store;
    return start - Math.max((end - start) * MARGIN, 1e-6);
  }

  get #latest() {
    const { start, end } = this.store;
    return end + Math.max((end - start) * MARGIN, 1e-6);
  }

  #x(time) {
    const [from, to] = this.window;
    return this.labelWidth + (Math.min(time, this.store.end + 1e9 /* an open span ends at Infinity */) - from) / (to - from) * (this.width - this.labelWidth);
  }

  #timeAt(x) {
    const [from, to] = this.window;
    return from + (x - this.labelWidth) / (this.width - this.labelWidth) * (to - from);
  }

  // --- drawing -----------------------------------------------------------------------------------------------------

  draw() {
    const { context, width, height } = prepared(this.canvas);
    Object.assign(this, { context, width, height, style: { lift: css("--lift"), weak: Number(css("--weak")), held: css("--handled") } });
    if (!this.store.head || width < 50) return;
    const choice = String(this.lastSeconds ?? (this.from === null && this.to === null ? "" : "part"));
    if (this.lastSelect.value !== choice) this.lastSelect.value = choice;
    context.font = "12px system-ui, Helvetica, Arial, sans-serif";
    context.textBaseline = "middle";
    this.#layOut();
    const area = { left: this.labelWidth, width, height };
    drawAxis(context, this.window, { ...area, x: (time) => this.#x(time) });
    this.futureNames = []; // functions that draw names over the veil
    this.#clipToRows(() => this.layout.forEach((box) => box.bottom > AXIS && box.top < height && this.#drawRow(box)));
    this.#drawRestarts();
    drawCursor(context, this.#x(Math.min(this.time, this.store.end)), area);
    this.#clipToRows(() => this.futureNames.forEach((draw) => draw()));
    this.scrollBar.show(this.tall, height - AXIS - 6, this.scroll, this.layout.filter((box) => box.top + LANE > height).length);
  }

  // Draw a line with a flag at each restart of central.
  #drawRestarts() {
    for (const { time } of this.store.restarts) {
      const x = this.#x(time);
      if (x < this.labelWidth || x > this.width) continue;
      this.#drawFlag(x, AXIS - 1, css("--restart"));
      this.context.fillRect(x - 0.75, AXIS, 1.5, this.height - AXIS);
    }
  }

  // Call `draw`, which can draw only below the axis.
  #clipToRows(draw) {
    const { context, width, height } = this;
    context.save();
    context.beginPath();
    context.rect(0, AXIS, width, height - AXIS);
    context.clip();
    draw();
    context.restore();
  }

  // Place the rows.
  #layOut() {
    const rows = inOrder(this.store.rows), widths = rows.map((row) => this.context.measureText(row.label).width);
    this.labelWidth = Math.min(Math.max(60, ...widths) + 16, this.width * 0.3);
    const [from, to] = this.#defaultWindow;
    const { layout, tall } = placed(rows, { scale: (this.width - this.labelWidth) / (to - from), now: this.store.end });
    Object.assign(this, { layout, tall });
    this.scroll = Math.min(Math.max(this.scroll, 0), Math.max(tall - (this.height - AXIS - 6), 0));
    for (const box of this.layout) {
      box.top += AXIS + 4 - this.scroll;
      box.bottom += AXIS + 4 - this.scroll;
    }
  }

  #drawRow(box) {
    const { row, top, bottom, handledLanes, queuedLanes, heldLanes, queuedStep, curveHeight } = box, { context } = this;
    context.fillStyle = css("--panel");
    for (const span of row.connected) {
      const x = Math.max(this.#x(span.start), this.labelWidth);
      context.fillRect(x, top, Math.max(Math.min(this.#x(span.end), this.width) - x, 0), bottom - top);
    }
    let y = top;
    for (const lane of row.held.lists.slice(0, heldLanes)) {
      this.#drawLane(lane, y, THIN - 2, (span, x, w) => this.#drawHeld(x, w, y));
      y += THIN;
    }
    for (const lane of row.handled.lists.slice(0, handledLanes)) {
      this.#drawLane(lane, y, LANE - 2, (span, x, w) => this.#drawBar(span, x, w, y));
      y += LANE;
    }
    y = top + heldLanes * THIN + handledLanes * LANE; // a row without handled spans has an empty lane
    for (const lane of row.queued.lists.slice(0, queuedLanes)) {
      this.#drawLane(lane, y, queuedStep - 2, (span, x, w) => this.#drawQueued(span, x, w, y, queuedStep - 2));
      y += queuedStep;
    }
    if (curveHeight) this.#drawCurve(row, y, curveHeight - 2);
    for (const span of row.failed) {
      const x = this.#x(span.end);
      if (x >= this.labelWidth && x <= this.width && x - this.#x(span.start) < 4) this.#drawFlag(x, top, this.#frameColour(span));
    }
    for (const change of row.changes) this.#drawInstant(change, css("--ink"), box);
    for (const failure of row.raised) this.#drawInstant(failure, css(wasHandled(failure, this.time) ? "--handled" : "--bad"), box);
    context.fillStyle = css("--paper");
    context.fillRect(0, top - BETWEEN / 2, this.labelWidth - 1, bottom - top + BETWEEN);
    context.fillStyle = css("--ink");
    context.textAlign = "right";
    context.fillText(clipped(context, row.label, this.labelWidth - 14), this.labelWidth - 8, top + heldLanes * THIN + (handledLanes ? LANE : queuedStep) / 2 - 1);
  }

  // Draw the spans of a lane that are in sight. Narrow spans are merged, one for each column of MERGED_BELOW pixels.
  #drawLane(lane, y, tall, draw) {
    const [from, to] = this.window;
    let place = firstWith(lane, (span) => span.end > from);
    while (place < lane.length && lane[place].start < to) {
      const span = lane[place], x = Math.max(this.#x(span.start), this.labelWidth), end = Math.min(this.#x(span.end), this.width);
      if (end - x >= MERGED_BELOW) {
        draw(span, x, end - x);
        place++;
      } else {
        const next = this.#timeAt(x + MERGED_BELOW);
        const after = Math.max(place + 1, firstWith(lane, (other) => other.end > next, place + 1));
        const busy = after > place + 1 ? busyShare(lane, place, after, next - this.#timeAt(x)) : 0.75;
        this.context.fillStyle = span.kind === "held" ? this.style.held : this.store.colour(span.name);
        this.context.globalAlpha = 0.2 + 0.8 * busy; // the fuller, the larger the busy share
        this.context.fillRect(x, y, MERGED_BELOW, tall);
        this.context.globalAlpha = 1;
        place = after;
      }
    }
  }

  #drawBar(span, x, width, y) {
    const { context } = this, tall = LANE - 2, open = span.end === Infinity;
    const end = Math.min(x + width, open ? this.#x(this.store.end) : Infinity), wide = Math.max(end - x, MERGED_BELOW);
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
    const isChosen = span.message && span.message === this.chosen, inset = isChosen ? 1 : 0; // the frame of a failure lies inside that of the choice
    const left = span.end > this.time ? Math.max(this.#x(this.time), x) : x; // before the failure, only the future part of the bar has its frame
    if (span.outcome === "failed") this.#drawFrame(left + inset, y + inset, x + wide - left - 2 * inset, tall - 2 * inset, this.#frameColour(span), 2);
    if (span.outcome === "killed" && wide > 6) {
      context.fillStyle = css("--ink"); // a dark end
      context.fillRect(x + wide - 3, y, 3, tall);
    }
    if (isChosen) this.#drawFrame(x - 1, y - 1, wide + 2, tall + 2, css("--ink"), 2);
    if (wide > 34) this.#drawName(span, x, y, wide, tall);
  }

  // Draw a blue strip over the time for which a task ran ahead of its state; a dashed one if it was wasted.
  #drawAhead(x, end, y, isWasted) {
    const { context } = this;
    context.fillStyle = "#ffffff";
    context.fillRect(x, y, end - x, STRIP_HEIGHT + 1);
    context.fillStyle = "#7ab4f0";
    for (let left = x; left < end; left += isWasted ? 2 * STRIP_HEIGHT : Infinity) {
      context.fillRect(left, y, Math.min(isWasted ? STRIP_HEIGHT : Infinity, end - left), STRIP_HEIGHT);
    }
  }

  // Draw the name on a bar. The future part is written in dark letters, after the veil has made the bar paler.
  #drawName(span, x, y, wide, tall) {
    const { context } = this, begin = Math.max(x, this.labelWidth) + 4, nowX = this.#x(Math.min(this.time, this.store.end));
    const words = clipped(context, span.kind === "waiting" ? `waits for ${span.name}` : span.name, x + wide - begin - 2);
    const nameEnd = begin + context.measureText(words).width, write = (left, right, colour) => {
      context.save();
      context.beginPath();
      context.rect(left, y, right - left, tall);
      context.clip();
      context.fillStyle = colour;
      context.textAlign = "left";
      context.fillText(words, begin, y + tall / 2 + 0.5);
      context.restore();
    };
    const ink = css("--ink"), inkOnBar = span.kind === "waiting" ? ink : isLight(span, this.#timeAt(begin), this.#timeAt(nameEnd)) ? "#111" : "#fff";
    if (nowX > begin) write(x, Math.min(x + wide, nowX), inkOnBar);
    if (nameEnd > nowX) this.futureNames.push(() => write(Math.max(x, nowX), x + wide, ink));
  }

  // Draw a stroke across the bar, with a flag, at a failure that was raised from outside the handler or at a client's request.
  #drawInstant({ time, span }, colour, { top, heldLanes, handledLanes, queuedLanes, queuedStep }) {
    const { context } = this, x = this.#x(time), isQueued = span.kind === "queued", tall = isQueued ? queuedStep - 2 : LANE - 2;
    if (x < this.labelWidth || x > this.width) return;
    const y = top + heldLanes * THIN + (isQueued ? handledLanes * LANE + Math.min(span.lane, queuedLanes - 1) * queuedStep : Math.min(span.lane, handledLanes - 1) * LANE);
    context.fillStyle = css("--paper");
    context.fillRect(x - 2, y, 4, tall); // visible also on a bar of the same colour
    context.fillStyle = colour;
    context.fillRect(x - 1, y, 2, tall);
    this.#drawFlag(x, y, context.fillStyle);
  }

  // Draw a waiting bar: weaker than a handled one; on a dark page also lighter, to be visible.
  #drawQueued(span, x, width, y, tall) {
    const { context } = this, wide = Math.min(x + width, this.#x(Math.min(span.end, this.store.end))) - x;
    context.fillStyle = `color-mix(in srgb, white ${this.style.lift}, ${this.store.colour(span.name)})`;
    context.globalAlpha = this.style.weak;
    context.fillRect(x, y, Math.max(wide, MERGED_BELOW), tall);
    context.globalAlpha = 1;
    context.fillRect(x, y, 1.5, tall);
    if (span.message === this.chosen) this.#drawFrame(x, y, wide, tall, css("--ink"), 1.5);
    if (tall < NAMED - 2 || wide < 34) return;
    context.save();
    context.font = "11px system-ui, Helvetica, Arial, sans-serif";
    context.fillStyle = css("--ink");
    context.textAlign = "left";
    const left = Math.max(x, this.labelWidth) + 4;
    context.fillText(clipped(context, span.message ? `${span.name} ${span.message}` : span.name, x + wide - left - 2), left, y + tall / 2 + 0.5);
    context.restore();
  }

  // Draw the queue length as a curve.
  #drawCurve(row, y, tall) {
    const { store: { end } } = this, [from, to] = this.window, left = Math.floor(this.labelWidth);
    const wide = Math.max(Math.ceil(Math.min(this.#x(end), this.width) - left), 0);
    const times = Array.from({ length: wide + 1 }, (_, x) => Math.min(Math.max(this.#timeAt(left + x), from), to, end));
    const style = { ink: css("--ink"), paper: css("--paper"), state: row.suspends ? "suspended" : "queued" };
    drawCurve(this.context, row.queued.peaks(times), { left, y, tall, ...style });
  }

  #drawHeld(x, width, y) {
    this.context.fillStyle = this.style.held;
    this.context.fillRect(x, y, Math.max(Math.min(x + width, this.#x(this.store.end)) - x, MERGED_BELOW), THIN - 3);
  }

  // The colour of a failed span: red, or amber if the failure was handled; yellow if its task was done after it.
  #frameColour(span) {
    const task = this.store.byId.get(span.message);
    if (task?.states?.at(-1) === RESOLVED && this.store.stateAt(task, this.time) === RESOLVED) return css("--resolved");
    return css(wasHandled(span.failure, this.time) ? "--handled" : "--bad");
  }

  #drawFrame(x, y, width, tall, style, thick) {
    this.context.strokeStyle = style;
    this.context.lineWidth = thick;
    this.context.strokeRect(x + 0.5, y + 0.5, Math.max(width - 1, 1), tall - 1);
    this.context.lineWidth = 1;
  }

  #drawFlag(x, y, colour) {
    this.context.fillStyle = colour;
    this.context.beginPath();
    this.context.moveTo(x - 4, y - 5);
    this.context.lineTo(x + 4, y - 5);
    this.context.lineTo(x, y + 1);
    this.context.fill();
  }

  // --- the mouse ---------------------------------------------------------------------------------------------------

  // The span at a place of the canvas, with a wait, failure or change of it at that place; null if there is none.
  hitAt(x, y) {
    if (x < this.labelWidth) return null;
    for (const { row, top, bottom, handledLanes, heldLanes, queuedLanes, queuedStep } of this.layout) {
      if (y < top || y > bottom) continue;
      const below = y - top - heldLanes * THIN; // the held lanes
      const lane = below < 0 ? row.held.lists[Math.floor((y - top) / THIN)]
        : below < handledLanes * LANE ? row.handled.lists[Math.floor(below / LANE)]
          : row.queued.lists.slice(0, queuedLanes)[Math.floor((below - handledLanes * LANE) / queuedStep)];
      const time = this.#timeAt(x), near = this.#timeAt(x + 3) - time;
      const span = lane?.[firstWith(lane, (other) => other.end >= time - near)];
      if (!span || span.start > time + near) return null;
      const wait = span.waits.find((one) => one.start <= time && one.end >= time);
      const isNear = (one) => one.span === span && Math.abs(one.time - time) <= 1.5 * near;
      return { span, wait, row, failure: row.raised.find(isNear), change: row.changes.find(isNear) };
    }
    return null;
  }

  #listen() {
    const { canvas } = this;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (event.shiftKey || event.offsetX < this.labelWidth) this.scroll += event.deltaY;
      else this.#zoom(event.offsetX, Math.exp(event.deltaY * 0.0015));
      this.draw();
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      this.drag = { x: event.offsetX, y: event.offsetY, scroll: this.scroll, window: this.window, moved: false };
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.drag) this.#pan(event, this.drag);
      else this.#showHint(event);
    });
    canvas.addEventListener("pointerup", (event) => {
      const { drag } = this;
      this.drag = null;
      if (drag && !drag.moved) this.#click(event);
    });
    canvas.addEventListener("pointercancel", () => { this.drag = null; });
    canvas.addEventListener("pointerleave", () => { this.hint.hidden = true; });
    canvas.addEventListener("dblclick", () => this.zoomOut());
  }

  #click(event) {
    const found = event.offsetY > AXIS && this.hitAt(event.offsetX, event.offsetY);
    if (found && found.span.message) this.choose(found.wait?.message || found.span.message); // a wait for a lock has no message
    else if (event.offsetX > this.labelWidth) this.setTime(this.#timeAt(event.offsetX), { followCurrent: true });
  }

  #zoom(x, factor) {
    this.#stopFollowing();
    const [from, to] = this.window, centre = this.#timeAt(x);
    const shortest = 1e-6, longest = Math.max((this.store.end - this.#earliest) * 1.05, this.#shortest) + 1e-3;
    const wide = Math.min(Math.max((to - from) * factor, shortest), longest), share = (centre - from) / (to - from);
    this.from = centre - share * wide;
    this.to = this.from + wide;
    if (wide >= longest) {
      this.from = this.#earliest;
      this.to = null;
    }
  }

  #pan(event, drag) {
    const dx = event.offsetX - drag.x, dy = event.offsetY - drag.y;
    if (Math.abs(dx) + Math.abs(dy) > 3) drag.moved = true;
    if (!drag.moved) return;
    this.#stopFollowing();
    const [from, to] = drag.window, shift = dx / (this.width - this.labelWidth) * (to - from);
    if (from > this.#earliest || this.to !== null) { this.from = from - shift; this.to = to - shift; }
    this.scroll = drag.scroll - dy;
    this.hint.hidden = true;
    this.draw();
  }

  #showHint({ offsetX, offsetY }) {
    this.pointer = { offsetX, offsetY };
    const found = offsetY > AXIS ? this.hitAt(offsetX, offsetY) : null;
    const restart = found ? null : this.store.restarts.find(({ time }) => Math.abs(this.#x(time) - offsetX) <= 4);
    this.hint.hidden = !(found || restart);
    if (this.hint.hidden) return;
    this.hint.textContent = found ? spanWords(found, this.store, this.time) : `${seconds(restart.time)}: ${restart.text}`;
    const left = Math.min(offsetX + 14, this.width - Math.min(this.hint.offsetWidth, this.width) - 4);
    this.hint.style.left = `${Math.max(left, 0)}px`;
    this.hint.style.top = `${Math.min(offsetY + 16, this.height - 26)}px`;
  }
}

// The share of `seconds` that the spans of a lane between two places take.
function busyShare(lane, from, to, seconds) {
  const sums = (lane.sums ??= [0]); // for each place, the total length of the spans before it
  while (sums.length <= to) {
    const span = lane[sums.length - 1];
    if (span.end === Infinity) return 1;
    sums.push(sums[sums.length - 1] + span.end - span.start);
  }
  return Math.min((sums[to] - sums[from]) / seconds, 1);
}

// Whether a bar is light in more than half of a time, since its handler waits there.
function isLight({ kind, waits }, from, to) {
  let light = 0;
  for (const wait of waits) light += Math.max(Math.min(wait.end, to) - Math.max(wait.start, from), 0);
  return kind === "waiting" || light > (to - from) / 2;
}
