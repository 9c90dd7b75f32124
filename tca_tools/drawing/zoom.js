// Zoom with the wheel, pan by dragging. A wide chart keeps its labels in sight, and the names of bars that begin left of
// what is seen.

const main = document.querySelector('main'), plot = document.querySelector('.zoomed');
const wide = plot.classList.contains('wide'), box = plot.viewBox.baseVal;
const labels = document.getElementById('fixed');
let zoom = 1, held = null, isAll = true;
const names = Array.from(plot.querySelectorAll('[data-to]'), one => {
  const from = Number(one.getAttribute('x'));
  return {one, from, to: Number(one.dataset.to), x: from};
});
function keepNames() {
  if (!wide) return;
  const left = (labels.getBoundingClientRect().right - plot.getBoundingClientRect().left + 4) / zoom;
  for (const name of names) {
    const isCut = name.from < left && left < name.to;
    const last = isCut ? name.to - (name.one.getComputedTextLength() + 4) / zoom : name.from;
    const x = Math.max(name.from, Math.min(left, last));
    if (x !== name.x) name.one.setAttribute('x', name.x = x);
  }
}
const all = () => wide ? (main.clientWidth - labels.offsetWidth) / box.width : 1;
function show(to, x, y) {
  to = Math.min(Math.max(to, wide ? all() : 0.1), wide ? 64 : 8);
  isAll = to === all();
  const at = plot.getBoundingClientRect(), more = to / zoom - 1;
  zoom = to;
  plot.style.setProperty('--zoom', zoom);
  plot.setAttribute('width', box.width * zoom);
  if (!wide) plot.setAttribute('height', box.height * zoom);
  plot.classList.toggle('at4', zoom >= 4); plot.classList.toggle('at16', zoom >= 16);
  if (wide) for (const one of plot.querySelectorAll('pattern'))
    one.setAttribute('patternTransform', `scale(${1 / zoom},1) ${one.dataset.lean}`);
  main.scrollLeft += (x - at.left) * more;
  if (!wide) main.scrollTop += (y - at.top) * more;
  keepNames();
}
main.onscroll = keepNames;
main.onwheel = e => {
  if (e.shiftKey) return;
  e.preventDefault();
  show(zoom * 1.2 ** -Math.sign(e.deltaY), e.clientX, e.clientY);
};
main.onpointerdown = e => {
  held = [e.clientX + main.scrollLeft, e.clientY + main.scrollTop];
  main.classList.add('held');
};
onpointermove = e => { if (held) { main.scrollLeft = held[0] - e.clientX; main.scrollTop = held[1] - e.clientY; } };
onpointerup = () => { held = null; main.classList.remove('held'); };
for (const button of document.querySelectorAll('nav button'))
  button.onclick = () => show(button.value == 0 ? all() : zoom * button.value, innerWidth / 2, innerHeight / 2);
function fit() { if (wide && isAll) show(all(), 0, 0); }
onresize = fit;
fit();
