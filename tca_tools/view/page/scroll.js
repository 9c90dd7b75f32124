// The chart's scroll bar, and the button with the number of rows below the visible ones. Both are shown only if needed.

import { element } from "./dom.js";

const BAR = 15; // pixels, as in style.css

export class ScrollBar {
  // `onScroll` is called with the scrolled distance in pixels.
  constructor(canvas, onScroll) {
    this.canvas = canvas;
    this.content = element("div");
    this.bar = element("div", { id: "chart-bar", hidden: true }, this.content);
    this.below = element("button", { id: "chart-below", hidden: true, title: "scroll down" });
    canvas.after(this.bar, this.below);
    this.bar.addEventListener("scroll", () => onScroll(this.bar.scrollTop));
    this.below.addEventListener("click", () => onScroll(this.bar.scrollTop + this.bar.clientHeight * 0.8));
  }

  // Show the bar as needed. `height`: of all rows; `visible`: of the visible part; `scroll`: the scrolled distance; `below`: the
  // number of rows below.
  show(height, visible, scroll, below) {
    const isNeeded = height > visible + 1;
    this.bar.hidden = !isNeeded;
    this.below.hidden = !below;
    this.below.textContent = `▾ ${below} more ${below === 1 ? "row" : "rows"} below`;
    const width = isNeeded ? `calc(100% - ${BAR}px)` : "";
    if (this.canvas.style.width !== width) this.canvas.style.width = width; // the chart observes its size, and is drawn again
    if (!isNeeded) return;
    this.content.style.height = `${height - visible + this.bar.clientHeight}px`;
    if (Math.abs(this.bar.scrollTop - scroll) > 1) this.bar.scrollTop = scroll;
  }
}
