// What the server told of a moment is shown until there is news; but the rows have gone on since. What of it can't be so
// any more is left out: what names tasks that have ended, or (of the end of a wait) that are in another state.

// The number of the last entry that is known at a time, as a time.
export function toldOf(store, moment) { return store.times[moment] ?? -Infinity; }

// Whether a text names a task that is in another state than when it was told.
export function hasChanged(store, text, told, time) {
  return named(store, text).some((task) => store.entered(task, told) !== store.entered(task, time));
}

// Whether a text names a task that has ended since.
export function hasEnded(store, text, told, time) {
  return named(store, text).some((task) => store.ended(task, time) !== null && store.ended(task, told) === null);
}

// What may be said still of a note: undefined if nothing.
export function lasting(store, note, time) {
  if (hasEnded(store, note.text, note.told, time)) return undefined;
  return hasChanged(store, note.alone, note.told, time) ? { ...note, end: "", alone: "", whole: note.whole.replace(note.end, "").trim() } : note;
}

function named(store, text) {
  return [...(text ?? "").matchAll(/\{(\d+)\}/g)].map(([, number]) => store.byId.get(Number(number))).filter(Boolean);
}
