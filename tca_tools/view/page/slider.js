// The time slider: the number of entries over time, failures in red or amber, restarts of central in violet, and a handle to drag; also play, steps and speed.

import { css, prepared } from "./dom.js";
import { duration, seconds } from "./words.js";

const EDGE = 7; // pixels beside the track
const LONGEST_SILENCE = 5; // seconds until the next entry when a run is played: a longer silence is played faster

export class Slider {
  constructor(store, { setTime, playTo, reveal, followCurrent }) {
    Object.assign(this, { store, setTime, playTo, reveal, followCurrent });
    this.time = 0;
    this.playing = null;
    this.canvas = document.getElementById("slider");
    this.clock = document.getElementById("clock");
    const onClick = (id, work) => document.getElementById(id).addEventListener("click", work);
    onClick("back", () => this.step(-1));
    onClick("on", () => this.step(1));
    onClick("play", () => this.toggle());
    onClick("follow", () => setTime(Infinity));
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

  // Go to the next entry, or with -1 to the previous one.
  step(by) {
    this.stop();
    const { times } = this.store, place = this.store.lastEntry(this.time) + by;
    if (place >= times.length) this.setTime(Infinity);
    if (place < 0 || place >= times.length) return;
    this.setTime(times[place]);
  }

  // Go to the next failure (by: 1) or the previous one (-1). Returns the number of its message; undefined if there is no such failure.
  stepToFailure(by) {
    const { failures } = this.store;
    const next = by > 0 ? failures.find(({ time }) => time > this.time) : failures.findLast(({ time }) => time < this.time);
    if (!next) return undefined;
    this.setTime(next.time);
    return next.message;
  }

  toggle() {
    if (!this.playing) return this.#play();
    this.setTime(this.playing.time); // stops, and draws all parts of the page at that time
  }

  stop() {
    if (!this.playing) return;
    cancelAnimationFrame(this.playing.frame);
    this.playing = null;
    document.getElementById("play").textContent = "▶";
    this.#showHaste(false);
  }

  // Play from the time shown; at the end of the run, from its start.
  #play() {
    document.getElementById("play").textContent = "❚❚";
    if (this.time >= this.store.last) this.time = this.store.start;
    this.playing = { last: performance.now(), frame: 0, time: this.time };
    this.reveal(this.time);
    this.followCurrent(); // until the user scrolls
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

  // The speed at a time, in seconds of the run a second: the chosen one, or a higher one in a long silence.
  #speedAt(time) {
    const { times } = this.store, place = this.store.lastEntry(time);
    const silence = place < 0 || place + 1 >= times.length ? 0 : times[place + 1] - times[place];
    const chosen = Number(document.getElementById("speed").value), speed = Math.max(chosen, silence / LONGEST_SILENCE);
    this.#showHaste(speed > chosen, silence);
    return speed;
  }

  #showHaste(isFaster, silence) {
    this.clock.classList.toggle("faster", isFaster);
    this.clock.title = isFaster ? `no message for ${duration(silence)}: played faster` : "";
  }

  #drag(event) {
    this.stop();
    const { start, end } = this.store, share = (event.offsetX - EDGE) / (this.canvas.clientWidth - 2 * EDGE);
    this.setTime(share >= 1 ? Infinity : start + Math.max(share, 0) * (end - start), { followCurrent: true });
  }

  draw() {
    const { context, width, height } = prepared(this.canvas);
    const { times, start, end } = this.store, trackWidth = width - 2 * EDGE;
    if (!times.length || trackWidth < 10) return;
    const x = (time) => EDGE + (end > start ? (time - start) / (end - start) : 1) * trackWidth;
    context.fillStyle = css("--line");
    context.fillRect(EDGE, height - 8, trackWidth, 4);
    context.fillStyle = css("--faint");
    context.globalAlpha = 0.5;
    const { bins, until } = this.#bins(Math.floor(trackWidth / 3)), largest = Math.max(...bins, 1);
    const binWidth = (x(until) - EDGE) / bins.length;
    bins.forEach((count, bin) => {
      const barHeight = count ? 1 + Math.sqrt(count / largest) * (height - 12) : 0;
      context.fillRect(EDGE + bin * binWidth, height - 8 - barHeight, binWidth * 0.75, barHeight);
    });
    context.globalAlpha = 1;
    context.fillStyle = css("--mark");
    context.fillRect(EDGE, height - 8, x(this.time) - EDGE, 4);
    context.fillStyle = css("--restart");
    for (const { time } of this.store.restarts) context.fillRect(x(time) - 0.75, 2, 1.5, height - 10);
    this.#drawFailures(context, x, height);
    context.fillStyle = css("--mark");
    context.beginPath();
    context.arc(x(this.time), height - 6, 5.5, 0, 7);
    context.fill();
  }

  // Draw handled failures first, so that the others are on top.
  #drawFailures(context, x, height) {
    const { failures, version } = this.store;
    if (this.marks?.version !== version) this.marks = { version, ...Object.groupBy(failures, (one) => one.handled ? "handled" : "bad") };
    for (const kind of ["handled", "bad"]) {
      context.fillStyle = css(`--${kind}`);
      for (const { time } of this.marks[kind] ?? []) context.fillRect(x(time) - 1, height - 9, 2, 7);
    }
  }

  // The number of entries in each part of the run: counted again when new rows have arrived, or the run is a part longer.
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
