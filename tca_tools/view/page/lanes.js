// Spans of time in lanes, in each of which nothing overlaps, as the other charts lay them (see gantt/bars.py). Of a run
// that goes on many are open at a time, all that wait in a queue, and their ends come later.

export class Lanes {
  constructor() {
    this.lists = []; // of spans, by lane
    this.room = 1; // lanes for which there are leaves: a power of two
    this.earliest = new Float64Array(2).fill(Infinity); // a tree: of each half of the lanes under a node the earliest end; the leaves are behind
  }

  get length() { return this.lists.length; }

  // Into the first lane in which nothing else goes on.
  put(span) {
    span.lanes = this;
    span.lane = this.#firstFree(span.start);
    if (span.lane === this.lists.length) this.lists.push([]);
    if (span.lane >= this.room) this.#grow();
    this.lists[span.lane].push(span);
    this.ended(span);
  }

  // A span's end is known, or another one than before.
  ended(span) {
    if (span !== this.lists[span.lane].at(-1)) return; // another one has begun behind it: that counts
    let node = this.room + span.lane;
    for (this.earliest[node] = span.end; node > 1;) {
      node >>= 1;
      this.earliest[node] = Math.min(this.earliest[2 * node], this.earliest[2 * node + 1]);
    }
  }

  #firstFree(time) {
    if (this.earliest[1] > time) return this.lists.length;
    let node = 1;
    while (node < this.room) node = this.earliest[2 * node] <= time ? 2 * node : 2 * node + 1;
    return node - this.room;
  }

  #grow() {
    const { earliest, room } = this;
    this.room = 2 * room;
    this.earliest = new Float64Array(4 * room).fill(Infinity);
    this.earliest.set(earliest.subarray(room), 2 * room);
    for (let node = this.room - 1; node > 0; node--) this.earliest[node] = Math.min(this.earliest[2 * node], this.earliest[2 * node + 1]);
  }
}
