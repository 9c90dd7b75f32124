// How many go on at a time, and at most between two times: running counts in the order of time, with maxima over runs of
// sixteen of them, over sixteen of those, and so on. What is new is noted, and put in order when somebody asks.

const BITS = 4;
const SIZE = 1 << BITS;

export class Counts {
  constructor() {
    this.times = [];
    this.changes = []; // 1: one begins; -1: one ends
    this.levels = [[]]; // the counts from each of these times on; behind them, maxima of sixteen of the level before
    this.fresh = []; // [time, change]: not yet in order
  }

  add(time, change) { this.fresh.push([time, change]); }

  at(time) {
    this.#settle();
    return this.#before(upTo(this.times, time));
  }

  // What is over as soon as it began counts nowhere.
  most(from, until) {
    this.#settle();
    if (!(until > from)) return 0;
    const first = upTo(this.times, from);
    return Math.max(this.#before(first), this.#highest(first, before(this.times, until)));
  }

  #before(place) { return place ? this.levels[0][place - 1] : 0; }

  // The highest count of some places, 0 if there are none.
  #highest(first, behind) {
    let most = 0;
    for (const counts of this.levels) {
      while (first < behind && first & SIZE - 1) most = Math.max(most, counts[first++]);
      while (first < behind && behind & SIZE - 1) most = Math.max(most, counts[--behind]);
      if (first >= behind) return most;
      first >>= BITS;
      behind >>= BITS;
    }
    return most;
  }

  // Of one time ends come before beginnings: so no count in between is higher than those before and after.
  #settle() {
    const { times, changes } = this;
    if (!this.fresh.length) return;
    const kept = before(times, this.fresh.reduce((first, [time]) => Math.min(first, time), Infinity));
    const tail = times.slice(kept).map((time, i) => [time, changes[kept + i]]); // little, if anything
    const fresh = tail.concat(this.fresh).sort(([time, change], [other, another]) => time - other || change - another);
    times.length = changes.length = kept;
    this.levels.forEach((counts, level) => { counts.length = Math.min(counts.length, kept >> level * BITS); });
    for (const [time, change] of fresh) {
      times.push(time);
      changes.push(change);
      this.#push(this.#before(times.length - 1) + change);
    }
    this.fresh = [];
  }

  // A run of sixteen that is full becomes one in the level above.
  #push(count) {
    this.levels[0].push(count);
    for (let level = 0; this.levels[level].length % SIZE === 0; level++) {
      (this.levels[level + 1] ??= []).push(Math.max(...this.levels[level].slice(-SIZE)));
    }
  }
}

// The number of times in a sorted list that are not beyond one.
function upTo(times, time) { return place(times, (one) => one <= time); }

// The number of those before it.
function before(times, time) { return place(times, (one) => one < time); }

function place(times, holds) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (holds(times[middle])) low = middle + 1;
    else high = middle;
  }
  return low;
}
