"""A picture as a page of its own: one file, nothing fetched, hover titles, zoom with the wheel, pan by dragging.

A chart is made wider only, with its labels in sight, and the names of bars that begin left of what is seen; any other
picture is made larger as a whole.
"""

import re
from html import escape

_STYLE = """\
html, body { margin: 0; height: 100%; font: 13px Helvetica, Arial, "Liberation Sans", sans-serif; color: #1f2933; }
body { display: flex; flex-direction: column; } svg { display: block; }
nav { padding: 6px 24px; background: #f1f3f5; border-bottom: 1px solid #d9dee4; } nav button { min-width: 2.2em; }
main { flex: 1; overflow: auto; cursor: grab; display: flex; align-items: flex-start; }
main.held { cursor: grabbing; user-select: none; }
#fixed { position: sticky; left: 0; background: #ffffff; z-index: 1; }
header { overflow-x: auto; flex: none; max-height: 40%; } .zoomed { flex: none; }
.wide rect, .wide line, .wide path { vector-effect: non-scaling-stroke; }
.wide text { transform: scaleX(calc(1 / var(--zoom, 1))); transform-box: fill-box; transform-origin: left; }
.wide .tick { transform-origin: center; } .wide .before { transform-origin: right; }
.wide .after { transform-origin: left; }
.wide .flag { transform: scaleX(calc(1 / var(--zoom, 1))); transform-box: fill-box; transform-origin: center; }
.z4, .z16 { display: none; } .at4 .z4, .at16 .z16 { display: inline; }"""
_SCRIPT = """\
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
fit();"""
_NAVIGATION = """\
<nav><button value="2">+</button> <button value="0.5">-</button> <button value="0">all</button>
wheel: zoom, drag: move, hover: details</nav>"""


def zoomed_page(title: str, svg: str) -> str:
    """A page with one picture; *svg* is a document that begins with ``<svg ``."""
    start = svg.index("<svg ") + len("<svg ")
    in_pixels = re.sub(r'((?:width|height)="[0-9.]+)pt"', r'\1"', svg[start:], count=2)
    return _page(title, f'<main><svg class="zoomed" {in_pixels}</main>')


def wide_page(title: str, head: str, labels: str, plot: str) -> str:
    """A page with a chart: its head, and below it labels that stay and a plot (``<svg ...>``) that gets wider."""
    inner = plot.replace("<svg ", '<svg class="zoomed wide" preserveAspectRatio="none" ', 1)
    return _page(title, f'<header>{head}</header>\n<main><div id="fixed">{labels}</div>{inner}</main>')


def _page(title: str, body: str) -> str:
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>\n'
        f"<style>{_STYLE}</style></head>\n<body>\n{_NAVIGATION}\n{body}\n<script>\n{_SCRIPT}\n</script></body></html>\n"
    )
