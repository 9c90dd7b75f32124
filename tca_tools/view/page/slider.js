// The time slider: how much happened when, failures in red or amber, and a handle that is dragged; play, steps and speed.

import { css, prepared } from "./dom.js";
import { duration, seconds } from "./words.js";

const EDGE = 7; // pixels beside the track
const LONGEST_SILENCE = 5; // seconds: so long it takes at most, however slow the run is played, until the next message

export class Slider {
  constructor(store, { setTime, playTo, reveal, keepUp }) {
    Object.assign(this, { store, setTime, playTo, reveal, keepUp });
    this.time = 0;
    this.playing = null;
    this.canvas = document.getElementById("slider");
    this.clock = document.getElementById("clock");
    const on = (id, work) => document.getElementById(id).addEventListener("click", work);
    on("back", () => this.step(-1));
    on("on", () => this.step(1));
    on("play", () => this.toggle());
    on("follow", () => setTime(Infinity));
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.#drag(event);
    });
    this.canvas.addEventListener("pointermove", (event) => event.buttons && this.#drag(event));
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  show(time, following) {
    this.time = Math.min(time, this.store.end);
    this.clock.textContent = seconds(this.time);
    const follow = document.getElementById("follow");
    follow.classList.toggle("on", following);
    this.canvas.setAttribute("aria-valuetext", seconds(this.time));
    this.draw();
  }

  // To another message.
  step(by) {
    this.stop();
    const { times } = this.store, place = this.store.place(this.time) + by;
    if (place >= times.length) this.setTime(Infinity);
    if (place < 0 || place >= times.length) return;
    this.setTime(times[place]);
  }

  // To another moment at which something failed; what failed there, if there is one.
  stepToFailure(by) {
    const { failures } = this.store;
    const next = by > 0 ? failures.find(({ time }) => time > this.time) : failures.findLast(({ time }) => time < this.time);
    if (!next) return undefined;
    this.setTime(next.time);
    return next.message;
  }

  toggle() {
    if (!this.playing) return this.#play();
    this.setTime(this.playing.time); // stops, and brings all parts of the page there
  }

  stop() {
    if (!this.playing) return;
    cancelAnimationFrame(this.playing.frame);
    this.playing = null;
    document.getElementById("play").textContent = "▶";
    this.#tellHaste(false);
  }

  // From where the run stands, or, at its end, from its beginning.
  #play() {
    document.getElementById("play").textContent = "❚❚";
    if (this.time >= this.store.last) this.time = this.store.start;
    this.playing = { last: performance.now(), frame: 0, time: this.time };
    this.reveal(this.time);
    this.keepUp(); // until the reader scrolls
    const tick = (now) => {
      const { playing } = this, speed = this.#speedAt(playing.time);
      playing.time += Math.max(now - playing.last, 0) / 1000 * speed;
      playing.last = Math.max(now, playing.last);
      if (playing.time >= this.store.last) {
        this.stop();
        this.setTime(Infinity, { keepPlaying: true });
        return;
      }
      playing.frame = requestAnimationFrame(tick);
      this.playTo(playing.time);
    };
    this.playing.frame = requestAnimationFrame(tick);
  }

  // Seconds of the run in a second: as the reader chose, or more where nothing happens for long.
  #speedAt(time) {
    const { times } = this.store, place = this.store.place(time);
    const silence = place < 0 || place + 1 >= times.length ? 0 : times[place + 1] - times[place];
    const chosen = Number(document.getElementById("speed").value), speed = Math.max(chosen, silence / LONGEST_SILENCE);
    this.#tellHaste(speed > chosen, silence);
    return speed;
  }

  #tellHaste(isFaster, silence) {
    this.clock.classList.toggle("faster", isFaster);
    this.clock.title = isFaster ? `no message for ${duration(silence)}: that is played faster` : "";
  }

  #drag(event) {
    this.stop();
    const { start, end } = this.store, share = (event.offsetX - EDGE) / (this.canvas.clientWidth - 2 * EDGE);
    this.setTime(share >= 1 ? Infinity : start + Math.max(share, 0) * (end - start), { keepUp: true });
  }

  draw() {
    const { context, width, height } = prepared(this.canvas);
    const { times, start, end } = this.store, wide = width - 2 * EDGE;
    if (!times.length || wide < 10) return;
    const x = (time) => EDGE + (end > start ? (time - start) / (end - start) : 1) * wide;
    context.fillStyle = css("--line");
    context.fillRect(EDGE, height - 8, wide, 4);
    context.fillStyle = css("--faint");
    context.globalAlpha = 0.5;
    const { bins, until } = this.#bins(Math.floor(wide / 3)), most = Math.max(...bins, 1);
    const wideOne = (x(until) - EDGE) / bins.length;
    bins.forEach((count, bin) => {
      const tall = count ? 1 + Math.sqrt(count / most) * (height - 12) : 0;
      context.fillRect(EDGE + bin * wideOne, height - 8 - tall, wideOne * 0.75, tall);
    });
    context.globalAlpha = 1;
    context.fillStyle = css("--mark");
    context.fillRect(EDGE, height - 8, x(this.time) - EDGE, 4);
    this.#drawFailures(context, x, height);
    context.fillStyle = css("--mark");
    context.beginPath();
    context.arc(x(this.time), height - 6, 5.5, 0, 7);
    context.fill();
  }

  // Those that were handled lie below the others.
  #drawFailures(context, x, height) {
    const { failures, version } = this.store;
    if (this.marks?.version !== version) this.marks = { version, ...Object.groupBy(failures, (one) => one.handled ? "handled" : "bad") };
    for (const tint of ["handled", "bad"]) {
      context.fillStyle = css(`--${tint}`);
      for (const { time } of this.marks[tint] ?? []) context.fillRect(x(time) - 1, height - 9, 2, 7);
    }
  }

  // How many entries fall into each part of the run; counted anew when there are more, or the run is a part longer.
  #bins(number) {
    const { times, start, end, version } = this.store, { binned } = this;
    const isLonger = binned && end - binned.until > (end - start) / number;
    if (binned?.version === version && binned.bins.length === number && !isLonger) return binned;
    const bins = new Array(Math.max(number, 1)).fill(0), scale = bins.length / (end - start || 1);
    for (const time of times) bins[Math.min(Math.floor((time - start) * scale), bins.length - 1)]++;
    this.binned = { version, bins, until: end };
    return this.binned;
  }
}
