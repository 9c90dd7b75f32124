// The bar at the right of the chart, and the button that says how many rows are below: both only where not all has room.

import { element } from "./dom.js";

const BAR = 15; // pixels, as in style.css

export class ScrollBar {
  // `moved` is called with how far the reader has scrolled, in pixels.
  constructor(canvas, moved) {
    this.canvas = canvas;
    this.room = element("div");
    this.bar = element("div", { id: "chart-bar", hidden: true }, this.room);
    this.below = element("button", { id: "chart-below", hidden: true, title: "show them" });
    canvas.after(this.bar, this.below);
    this.bar.addEventListener("scroll", () => moved(this.bar.scrollTop));
    this.below.addEventListener("click", () => moved(this.bar.scrollTop + this.bar.clientHeight * 0.8));
  }

  // After a picture: how tall all rows are and how much of that is seen, how far down they are, how many are below.
  show(tall, seen, scroll, below) {
    const isNeeded = tall > seen + 1;
    this.bar.hidden = !isNeeded;
    this.below.hidden = !below;
    this.below.textContent = `▾ ${below} more ${below === 1 ? "row" : "rows"} below`;
    const width = isNeeded ? `calc(100% - ${BAR}px)` : "";
    if (this.canvas.style.width !== width) this.canvas.style.width = width; // the chart hears of that, and draws anew
    if (!isNeeded) return;
    this.room.style.height = `${tall - seen + this.bar.clientHeight}px`;
    if (Math.abs(this.bar.scrollTop - scroll) > 1) this.bar.scrollTop = scroll;
  }
}
