"use strict";
// Draws `scene`: classes, objects, frames, truth, dead, extent, pictures; `objectsAt` holds every frame's objects.
const SVG = "http://www.w3.org/2000/svg";
const REGION = Math.sqrt(5.991); // 95 % of a Gaussian in the plane
const INK = "#14212b", GREY = "#6f7d89", SIGHT = "#0b62b8", MOVER = "#8a2be2";
const TRAIL = 15, AHEAD = 2, VAGUE = 3, FAINTEST = .15; // keyframes behind what moves, seconds ahead of it, sigma [m] from which on it is gone, opacity
const GAP = 2, NAMED = .2; // pixels beside a name, existence from which on an object has one; the likeliest choose their places first

// Objects are stored where they change, and without values where they are gone: what holds after a frame.
function objectsAfter(before, frame) {
  const state = before.slice();
  for (const [place, ...values] of frame.o) state[place] = values.length ? values : null;
  return state;
}

function make(parent, name, attributes, text) {
  const element = document.createElementNS(SVG, name);
  for (const key in attributes) element.setAttribute(key, attributes[key]);
  if (text !== undefined) element.textContent = text;
  parent.appendChild(element);
  return element;
}

function html(parent, name, className, text) {
  const element = document.createElement(name);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  parent.appendChild(element);
  return element;
}

const round = value => Math.round(value * 10) / 10;
function percent(p) { // as `wording.percent`: never rounded to 0 or 100 what is neither
  if (p <= 0) return "0 %";
  if (p >= 1 - 1e-9) return "100 %";
  if (p >= .9995) return "> 99.9 %";
  if (p < .0005) return "< 0.1 %";
  return (100 * p).toFixed(p >= .995 || p < .01 ? 1 : 0) + " %";
}

function track(i, j) { // rows from hypothesis j of keyframe i back to its root
  const rows = [];
  for (; i >= 0 && j >= 0; i--) {
    const h = scene.frames[i].h[j];
    rows.push(h);
    j = h[0];
  }
  return rows;
}

const heaviest = frame => frame.h.reduce((b, h, j) => h[1] > frame.h[b][1] ? j : b, 0);
const lightestFirst = frame => frame.h.map((h, j) => j).sort((a, b) => frame.h[a][1] - frame.h[b][1]);
const classesOf = o => o.slice(7, 7 + scene.classes.length); // probabilities of an object's classes
const colourOf = p => { const top = p.indexOf(Math.max(...p)); return p[top] > .5 ? scene.classes[top].colour : GREY; };

function nameOf(place, o) { // its label, and what it is once that is likelier than not
  const p = classesOf(o), top = p.indexOf(Math.max(...p));
  return scene.objects[place].label + (p[top] > .5 ? " " + scene.classes[top].name : "");
}

function shownObjects(objects, frame) { // [place in the list, probability, values]: an object is in each of its places, where it has several
  const several = new Map();
  for (const [place, ...own] of frame.p || []) several.set(place, [...(several.get(place) || []), own]);
  return objects.flatMap((o, place) => !o ? [] : !several.has(place) ? [[place, 1, o]] :
    several.get(place).map(([p, x, y, a, b, angle, ...inSpace]) => [place, p, [x, y, o[2], a, b, angle, ...o.slice(6, 7 + scene.classes.length), ...inSpace]]));
}

const widths = new Map(); // of names, in CSS pixels
function freePlace(px, py, wide, taken, width, height, off) { // of a name near a point: right, in the middle or left, above or below; null: nowhere
  const right = px + off, left = px - off - wide, middle = px - wide / 2;
  for (const [x, y] of [[right, py - 7], [right, py + 15], [middle, py - off - 3], [middle, py + off + 12], [left, py - 7], [left, py + 15]]) {
    const box = [x - GAP, y - 11, x + wide + GAP, y + 4];
    if (box[0] < 0 || box[1] < 0 || box[2] > width || box[3] > height) continue;
    if (taken.some(b => box[0] < b[2] && b[0] < box[2] && box[1] < b[3] && b[1] < box[3])) continue;
    taken.push(box);
    return [x, y];
  }
  return null;
}

class MapView {
  constructor(svg, small, height = 0) { // height: share of the width, 0: as the extent is, within limits
    this.svg = svg;
    this.small = small;
    let [x0, y0, x1, y1] = scene.extent;
    const aspect = height || Math.min(Math.max((y1 - y0) / (x1 - x0), 0.6), small ? 1 : 0.85);
    const grow = Math.max((y1 - y0) / aspect - (x1 - x0), 0) / 2, rise = Math.max((x1 - x0) * aspect - (y1 - y0), 0) / 2;
    [this.x0, this.x1, this.y0, this.y1] = [x0 - grow, x1 + grow, y0 - rise, y1 + rise];
    this.width = 800;
    this.scale = this.width / (this.x1 - this.x0);
    this.height = (this.y1 - this.y0) * this.scale;
    svg.setAttribute("viewBox", `0 0 ${this.width} ${round(this.height)}`);
  }
  x(value) { return round((value - this.x0) * this.scale); }
  y(value) { return round(this.height - (value - this.y0) * this.scale); }
  path(points) { return points.map(p => this.x(p[0]) + "," + this.y(p[1])).join(" "); }

  draw(i) {
    const u = this.u = this.width / (this.svg.clientWidth || this.width); // one CSS pixel
    this.svg.replaceChildren();
    this.labels = [];
    const step = this.grid();
    const line = (points, stroke, width, more) =>
      make(this.svg, "polyline", { points: this.path(points), fill: "none", stroke, "stroke-width": width * u, "stroke-linejoin": "round", "stroke-linecap": "round", ...more });
    line(scene.truth, "#ffd34d", this.small ? 5 : 8, { opacity: .8 });
    line(scene.dead, "#a3591a", 1.3, { "stroke-dasharray": `${5 * u} ${5 * u}`, opacity: .75 });
    const frame = scene.frames[i], best = heaviest(frame), order = lightestFirst(frame);
    for (const j of order)
      line(track(i, j).map(h => [h[2], h[3]]), j === best ? INK : GREY, j === best ? 2.2 : 1.4, { opacity: j === best ? 1 : Math.min(.9, .18 + Math.sqrt(frame.h[j][1])) });
    const everything = shownObjects(objectsAt[i], frame);
    for (const seen of frame.s) {
      const h = frame.h[best], found = everything.find(([place]) => place === seen); // the best hypothesis' place of it
      if (found) line([[h[2], h[3]], found[2].slice(0, 2)], SIGHT, 1, { opacity: .7 });
    }
    const moves = new Set((frame.m || []).map(m => m[0])), gone = (o, place) => moves.has(place) && o[3] > VAGUE;
    const exists = new Map(frame.e), shown = everything.filter(([place, , o]) => !gone(o, place));
    for (const [place, p, o] of shown)
      this.fading(exists.has(place) || p < 1 ? (exists.get(place) ?? 1) * p : undefined, () => this.object(o, scene.objects[place]));
    for (const at of scene.crosses || []) this.cross(at);
    for (const [place, vx, vy] of frame.m || []) {
      const o = objectsAt[i][place], past = objectsAt.slice(Math.max(0, i - TRAIL), i + 1).map(at => at[place]).filter(at => at);
      if (!o || o[3] > VAGUE) continue;
      line(past, MOVER, 1.6, { "stroke-dasharray": `${2 * u} ${3 * u}` });
      this.arrow(o[0], o[1], o[0] + AHEAD * vx, o[1] + AHEAD * vy);
    }
    for (const j of order) this.robot(frame.h[j], j === best);
    this.scaleBar(step);
    if (this.small) return;
    const sure = ([place]) => exists.get(place) ?? 1, named = shown.filter(own => sure(own) >= NAMED).sort((a, b) => sure(b) - sure(a));
    for (const [place, , o] of named) this.fading(exists.get(place), () => this.label(this.x(o[0]), this.y(o[1]), nameOf(place, o)));
    for (const [place, , o] of shown) this.question(this.x(o[0]), this.y(o[1]), scene.objects[place]);
  }

  grid() { // lines so many metres apart
    const span = this.x1 - this.x0, u = this.u, wanted = span / (this.small ? 4 : 8);
    const power = 10 ** Math.floor(Math.log10(wanted)), step = [1, 2, 5, 10].map(f => f * power).find(s => s >= wanted);
    for (let x = Math.ceil(this.x0 / step) * step; x < this.x1; x += step)
      make(this.svg, "line", { class: "gridline", x1: this.x(x), x2: this.x(x), y1: 0, y2: this.height });
    for (let y = Math.ceil(this.y0 / step) * step; y < this.y1; y += step)
      make(this.svg, "line", { class: "gridline", y1: this.y(y), y2: this.y(y), x1: 0, x2: this.width });
    return step;
  }

  scaleBar(step) { // over whatever lies in its corner, with a white edge
    const u = this.u, length = step * this.scale, y = this.height - 12 * u, x = 12 * u, text = +step.toPrecision(3) + " m";
    for (const [stroke, width] of [["#fff", 6], [GREY, 2]])
      make(this.svg, "line", { x1: x, x2: x + length, y1: y, y2: y, stroke, "stroke-width": width * u });
    make(this.svg, "text", { class: "scale", x: x + length + 6 * u, y: y + 4 * u, "font-size": 12 * u, "stroke-width": 4 * u }, text);
    this.labels.push([x, y - 7 * u, x + length + (6 + 7.5 * text.length) * u, this.height].map(value => value / u)); // as all labels, in CSS pixels
  }

  ellipse(x, y, a, b, angle, attributes) {
    const rx = Math.max(a * REGION * this.scale, .5), ry = Math.max(b * REGION * this.scale, .5);
    make(this.svg, "ellipse", { rx: round(rx), ry: round(ry), transform: `translate(${this.x(x)} ${this.y(y)}) rotate(${round(-angle * 180 / Math.PI)})`, ...attributes });
  }

  object(o, about) {
    const u = this.u, [x, y, yaw, a, b, angle, sigmaYaw] = o, p = classesOf(o), colour = colourOf(p), r = (this.small ? 4.5 : 7) * u;
    this.ellipse(x, y, a, b, angle, { fill: colour, "fill-opacity": .1, stroke: colour, "stroke-width": 1.3 * u });
    const px = this.x(x), py = this.y(y);
    if (sigmaYaw < .8 && !this.small)
      make(this.svg, "line", { x1: px, y1: py, x2: px + 2.1 * r * Math.cos(yaw), y2: py - 2.1 * r * Math.sin(yaw), stroke: colour, "stroke-width": 3 * u, "stroke-linecap": "round" });
    make(this.svg, "circle", { cx: px, cy: py, r: r + 1.5 * u, fill: "#fff" });
    if (p.length) this.pie(px, py, r, p);
    else make(this.svg, "circle", { cx: px, cy: py, r: r * .7, fill: colour });
    if (about.true) this.cross(about.true);
  }

  cross([x, y]) { // where an object truly is
    const tx = this.x(x), ty = this.y(y), c = (this.small ? 2.5 : 3.5) * this.u;
    make(this.svg, "path", { d: `M${tx - c} ${ty - c}L${tx + c} ${ty + c}M${tx - c} ${ty + c}L${tx + c} ${ty - c}`, stroke: INK, "stroke-width": 1.6 * this.u });
  }

  fading(existence, draw) { // what draw() makes, the fainter the less likely it exists
    if (existence === undefined) return draw();
    const whole = this.svg;
    this.svg = make(whole, "g", { opacity: Math.max(existence, FAINTEST) });
    draw();
    this.svg = whole;
  }

  question(x, y, about) { // an object that the page explains opens its account
    if (!document.getElementById("why-" + about.id)) return;
    const link = make(this.svg, "a", { href: "#why-" + about.id, "aria-label": "why " + about.label });
    make(link, "circle", { cx: x, cy: y, r: 14 * this.u, fill: "transparent" });
  }

  arrow(x0, y0, x1, y1) {
    const u = this.u, [ax, ay, bx, by] = [this.x(x0), this.y(y0), this.x(x1), this.y(y1)], turn = Math.atan2(by - ay, bx - ax), s = 6 * u;
    const wing = side => `${round(bx - s * Math.cos(turn + side * .5))} ${round(by - s * Math.sin(turn + side * .5))}`;
    make(this.svg, "path", { d: `M${ax} ${ay}L${bx} ${by}M${wing(1)}L${bx} ${by}L${wing(-1)}`, fill: "none", stroke: MOVER, "stroke-width": 2 * u });
  }

  label(px, py, text) { // beside a point, within the frame and where no other label stands
    const u = this.u, element = make(this.svg, "text", { class: "name", "font-size": 13 * u, "stroke-width": 3 * u }, text);
    const wide = widths.get(text) || element.getComputedTextLength() / u; // 0 where the map is not laid out yet
    widths.set(text, wide);
    const place = freePlace(px / u, py / u, wide, this.labels, this.width / u, this.height / u, 12);
    if (!place) return element.remove();
    element.setAttribute("x", round(place[0] * u));
    element.setAttribute("y", round(place[1] * u));
  }

  pie(x, y, r, p) {
    const total = p.reduce((s, v) => s + v, 0) || 1;
    let from = -Math.PI / 2;
    p.forEach((value, c) => {
      const share = value / total, to = from + share * 2 * Math.PI;
      if (share > .97) make(this.svg, "circle", { cx: x, cy: y, r, fill: scene.classes[c].colour });
      else if (share > .02) make(this.svg, "path", { fill: scene.classes[c].colour,
        d: `M${x} ${y}L${x + r * Math.cos(from)} ${y + r * Math.sin(from)}A${r} ${r} 0 ${share > .5 ? 1 : 0} 1 ${x + r * Math.cos(to)} ${y + r * Math.sin(to)}Z` });
      from = to;
    });
  }

  robot(h, best) {
    const [, weight, x, y, yaw, a, b, angle] = h, u = this.u, s = (this.small ? 5 : 7) * u;
    const colour = best ? INK : GREY, opacity = best ? 1 : Math.min(.9, .25 + Math.sqrt(weight));
    this.ellipse(x, y, a, b, angle, { fill: colour, "fill-opacity": .06 * opacity, stroke: colour, "stroke-width": (best ? 1.3 : 1) * u, opacity });
    make(this.svg, "path", { d: `M${1.5 * s} 0L${-s} ${.9 * s}L${-.5 * s} 0L${-s} ${-.9 * s}Z`, fill: colour, stroke: "#fff", "stroke-width": .8 * u, opacity,
      transform: `translate(${this.x(x)} ${this.y(y)}) rotate(${round(-yaw * 180 / Math.PI)})` });
  }
}

function panel(i) {
  const box = document.getElementById("panel"), frame = scene.frames[i];
  box.replaceChildren();
  html(box, "h4", "", frame.n === 1 ? "One hypothesis" : `Weights of the ${frame.n} hypotheses`);
  const sorted = frame.h.slice().sort((a, b) => b[1] - a[1]).slice(0, 6);
  sorted.forEach((h, rank) => {
    const row = html(box, "div", rank ? "bar" : "bar best");
    html(row, "span", "", percent(h[1]));
    html(row, "i").style.width = Math.max(100 * h[1], .5) + "%";
  });
  if (!frame.s.length) return void html(box, "h4", "", "Nothing in view");
  html(box, "h4", "", "In view, for the best hypothesis");
  for (const place of [...new Set(frame.s)]) {
    const p = objectsAt[i][place] ? classesOf(objectsAt[i][place]) : [], row = html(box, "div", "seen");
    const line = html(row, "div"), top = p.indexOf(Math.max(...p));
    html(line, "b", "", scene.objects[place].label);
    if (top < 0) continue;
    html(line, "span", "muted", scene.classes[top].name + " " + percent(p[top]));
    const bar = html(row, "span", "stacked");
    p.forEach((value, c) => { const part = html(bar, "i"); part.style.width = 100 * value + "%"; part.style.background = scene.classes[c].colour; });
  }
}

function picture(i) { // the newest one up to that keyframe
  const figure = document.getElementById("view"), shown = scene.pictures.filter(p => p.k <= scene.frames[i].k).pop() || null;
  if (!figure || figure.shown === shown) return;
  figure.shown = shown;
  figure.replaceChildren();
  if (!shown) return void html(figure, "figcaption", "", "No picture yet");
  const frame = html(figure, "div", "picture"), image = html(frame, "img");
  Object.assign(image, { src: shown.src, width: shown.width, height: shown.height, alt: "camera picture" });
  for (const [left, top, width, height, colour, verdict, places, text, label] of shown.boxes) {
    const box = html(frame, "div", `box ${verdict} ${places}`);
    Object.assign(box.style, { left: left + "%", top: top + "%", width: width + "%", height: height + "%" });
    box.style.setProperty("--c", colour);
    html(box, "span", "", text);
    if (label) html(box, "em", "", label);
  }
  html(figure, "figcaption", "", "Camera at keyframe " + shown.k);
}
