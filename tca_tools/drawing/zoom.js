// Zoom with the wheel, and pan by dragging. A wide chart keeps its labels in sight, and the names of bars that begin left of
// the visible part.

const main = document.querySelector('main'), plot = document.querySelector('.zoomed');
const isWide = plot.classList.contains('wide'), box = plot.viewBox.baseVal;
const labels = document.getElementById('fixed');
let zoom = 1, dragStart = null, isFitted = true;
const names = Array.from(plot.querySelectorAll('[data-to]'), text => { // from, to: the span in which a name may stand
  const from = Number(text.getAttribute('x'));
  return {text, from, to: Number(text.dataset.to), x: from};
});
function keepNamesInView() {
  if (!isWide) return;
  const left = (labels.getBoundingClientRect().right - plot.getBoundingClientRect().left + 4) / zoom;
  for (const name of names) {
    const isCut = name.from < left && left < name.to;
    const last = isCut ? name.to - (name.text.getComputedTextLength() + 4) / zoom : name.from;
    const x = Math.max(name.from, Math.min(left, last));
    if (x !== name.x) name.text.setAttribute('x', name.x = x);
  }
}
const fittingZoom = () => isWide ? (main.clientWidth - labels.offsetWidth) / box.width : 1;
// Change the zoom. The point at x, y of the window keeps its place.
function zoomTo(wanted, x, y) {
  const place = plot.getBoundingClientRect(), before = zoom;
  zoom = Math.min(Math.max(wanted, isWide ? fittingZoom() : 0.1), isWide ? 64 : 8);
  isFitted = zoom === fittingZoom();
  plot.style.setProperty('--zoom', zoom);
  plot.setAttribute('width', box.width * zoom);
  if (!isWide) plot.setAttribute('height', box.height * zoom);
  plot.classList.toggle('at4', zoom >= 4); plot.classList.toggle('at16', zoom >= 16);
  if (isWide) for (const pattern of plot.querySelectorAll('pattern'))
    pattern.setAttribute('patternTransform', `scale(${1 / zoom},1) ${pattern.dataset.lean}`);
  const growth = zoom / before - 1;
  main.scrollLeft += (x - place.left) * growth;
  if (!isWide) main.scrollTop += (y - place.top) * growth;
  keepNamesInView();
}
main.onscroll = keepNamesInView;
main.onwheel = event => {
  if (event.shiftKey) return;
  event.preventDefault();
  zoomTo(zoom * 1.2 ** -Math.sign(event.deltaY), event.clientX, event.clientY);
};
main.onpointerdown = event => {
  dragStart = [event.clientX + main.scrollLeft, event.clientY + main.scrollTop];
  main.classList.add('dragged');
};
onpointermove = event => {
  if (dragStart) { main.scrollLeft = dragStart[0] - event.clientX; main.scrollTop = dragStart[1] - event.clientY; }
};
onpointerup = () => { dragStart = null; main.classList.remove('dragged'); };
for (const button of document.querySelectorAll('nav button'))
  button.onclick = () => zoomTo(button.value == 0 ? fittingZoom() : zoom * button.value, innerWidth / 2, innerHeight / 2);
function fit() { if (isWide && isFitted) zoomTo(fittingZoom(), 0, 0); }
onresize = fit;
fit();
