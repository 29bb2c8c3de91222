// The map of a run in space, turned by hand. Rows of hypotheses go on with z, quaternion and ellipsoid, those of objects and of their places with z and ellipsoid.
const SOLID = Math.sqrt(7.815); // 95 % of a Gaussian in space
const START = { yaw: -.6, tilt: .55, zoom: 1 }, FAR = 4; // distance of the eye, in sizes of the scene
const FRUSTA = 24, SMALL = .05, LARGE = .1, ROOM = .25; // cameras along the path; how long they are, and how far things may come out of view, in sizes of the scene
const SHADE = "#c9d2d9", TRUTH = "#ffd34d", DEAD = "#a3591a", CIRCLES = [[0, 1], [1, 2], [0, 2]];

const three = (values, n) => values.slice(n, n + 3);
const placeOf = h => [h[2], h[3], h[8]], heightAt = () => 7 + scene.classes.length;
const objectPlace = o => [o[0], o[1], o[heightAt()]], objectAxes = o => o.slice(heightAt() + 1);
const axesOf = flat => [three(flat, 0), three(flat, 3), three(flat, 6)];

function turned([x, y, z, w], v) { // a vector by a unit quaternion
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const q = [x, y, z], t = cross(q, v).map(value => 2 * value), u = cross(q, t);
  return v.map((value, n) => value + w * t[n] + u[n]);
}

class SpaceView {
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    Object.assign(this, START);
    let held = null;
    canvas.addEventListener("pointerdown", event => { held = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointerup", () => { held = null; });
    canvas.addEventListener("pointercancel", () => { held = null; });
    canvas.addEventListener("pointermove", event => {
      if (!held) return;
      this.turn((event.clientX - held[0]) * .008, (event.clientY - held[1]) * .008);
      held = [event.clientX, event.clientY];
    });
    canvas.addEventListener("dblclick", () => { Object.assign(this, START); this.draw(this.i); });
    canvas.addEventListener("wheel", event => {
      if (document.activeElement !== canvas) return; // the page scrolls
      event.preventDefault();
      this.near(Math.exp(-event.deltaY * .0015));
    }, { passive: false });
    const keys = { ArrowLeft: [-.1, 0], ArrowRight: [.1, 0], ArrowUp: [0, -.1], ArrowDown: [0, .1] };
    canvas.addEventListener("keydown", event => {
      if (keys[event.key]) this.turn(...keys[event.key]);
      else if ("+=".includes(event.key)) this.near(1.2);
      else if (event.key === "-") this.near(1 / 1.2);
      else return;
      event.preventDefault();
    });
  }

  turn(yaw, tilt) {
    this.yaw += yaw;
    this.tilt = Math.min(Math.max(this.tilt + tilt, -Math.PI / 2), Math.PI / 2);
    this.draw(this.i);
  }

  near(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, .3), 30);
    this.draw(this.i);
  }

  clear() {
    const ratio = window.devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = this.canvas;
    Object.assign(this, { width, height, opacity: 1, labels: [] });
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  fit() { // the scene into the canvas, whatever way it is turned about the vertical; a run that grows is left some room
    const [x0, y0, x1, y1] = scene.extent, last = scene.frames.length - 1;
    const every = [...track(last, heaviest(scene.frames[last])).map(placeOf), ...shownObjects(objectsAt[last], scene.frames[last]).map(([, , o]) => objectPlace(o)), ...scene.truth];
    const points = every.filter(([x, y]) => x > x0 && x < x1 && y > y0 && y < y1), axes = [0, 1, 2];
    const low = axes.map(n => Math.min(...points.map(p => p[n]))), high = axes.map(n => Math.max(...points.map(p => p[n]))), room = ROOM * this.size;
    if (this.low && axes.every(n => low[n] >= this.low[n] - room && high[n] <= this.high[n] + room)) return;
    Object.assign(this, { low, high });
    this.centre = axes.map(n => (this.low[n] + this.high[n]) / 2);
    const across = Math.max(...points.map(p => Math.hypot(p[0] - this.centre[0], p[1] - this.centre[1])), .5), tall = (this.high[2] - this.low[2]) / 2;
    this.size = Math.hypot(across, tall);
    this.floor = this.low[2] - .1 * this.size;
    this.reach = [across, across * Math.sin(START.tilt) + tall * Math.cos(START.tilt)];
  }

  view(v) { // a vector as the eye has it: right, up, towards it
    const c = Math.cos(this.yaw), s = Math.sin(this.yaw), C = Math.cos(this.tilt), S = Math.sin(this.tilt);
    const along = s * v[0] + c * v[1];
    return [c * v[0] - s * v[1], along * S + v[2] * C, v[2] * S - along * C];
  }

  at(point) { // x, y on the canvas, scale there
    const v = this.view(point.map((value, n) => value - this.centre[n]));
    const whole = .44 * Math.min(this.width / this.reach[0], this.height / this.reach[1]);
    const scale = this.zoom * whole * FAR * this.size / Math.max(FAR * this.size - this.zoom * v[2], .2 * this.size);
    return [this.width / 2 + scale * v[0], this.height / 2 - scale * v[1], scale, v[2]];
  }

  line(points, colour, width, alpha = 1, dash = []) {
    const pen = this.pen;
    pen.beginPath();
    for (const point of points) pen.lineTo(...this.at(point).slice(0, 2));
    Object.assign(pen, { strokeStyle: colour, lineWidth: width, globalAlpha: alpha * this.opacity, lineJoin: "round", lineCap: dash.length ? "butt" : "round" });
    pen.setLineDash(dash);
    pen.stroke();
    pen.setLineDash([]);
  }

  draw(i) {
    this.i = i;
    this.clear();
    this.fit();
    const frame = scene.frames[i], best = frame.h[heaviest(frame)], objects = objectsAt[i], exists = new Map(frame.e);
    const path = track(i, heaviest(frame));
    this.grid();
    this.line(path.map(h => [h[2], h[3], this.floor]), SHADE, 1.5);
    this.line(scene.truth, TRUTH, 6, .8);
    this.line(scene.dead, DEAD, 1.3, .75, [5, 5]);
    for (const j of lightestFirst(frame)) if (frame.h[j] !== best) this.line(track(i, j).map(placeOf), GREY, 1.2, Math.min(.9, .18 + Math.sqrt(frame.h[j][1])));
    const every = Math.ceil(scene.frames.length / FRUSTA);
    path.forEach((h, n) => (i - n) % every === 0 && n && this.camera(h, SMALL, GREY, 1, .55));
    this.line(path.map(placeOf), INK, 2);
    const shown = shownObjects(objects, frame).map(([place, p, o]) => ({ place, o, at: this.at(objectPlace(o)), opacity: Math.max((exists.get(place) ?? 1) * p, FAINTEST) }));
    for (const seen of frame.s) {
      const found = shown.find(({ place }) => place === seen); // the likeliest of its places
      if (found) this.line([turnedBy(best, scene.camera[0]), objectPlace(found.o)], SIGHT, 1, .7);
    }
    shown.sort((a, b) => a.at[3] - b.at[3]);
    for (const { place, o, opacity } of shown) {
      this.opacity = opacity;
      this.object(o, scene.objects[place]);
    }
    this.opacity = 1;
    for (const at of scene.crosses || []) this.cross(at);
    for (const h of frame.h) if (h !== best) this.ellipsoid(placeOf(h), axesOf(h.slice(13)), GREY, .5);
    this.ellipsoid(placeOf(best), axesOf(best.slice(13)), INK, 1);
    this.camera(best, LARGE, INK, 1.6, 1);
    const sure = ({ place }) => exists.get(place) ?? 1, named = shown.reverse().filter(own => sure(own) >= NAMED).sort((a, b) => sure(b) - sure(a));
    for (const { place, o, at, opacity } of named) {
      this.opacity = opacity;
      this.label(at, nameOf(place, o));
    }
    this.opacity = 1;
    this.compass();
  }

  grid() { // the floor, below all that is there
    const wanted = this.size / 4, power = 10 ** Math.floor(Math.log10(wanted)), step = [1, 2, 5, 10].map(f => f * power).find(s => s >= wanted);
    const [left, near] = this.low.map(value => Math.floor(value / step)), [right, far] = this.high.map(value => Math.ceil(value / step));
    for (let x = left; x <= right; x++) this.line([[x * step, near * step, this.floor], [x * step, far * step, this.floor]], "#e3e9ee", 1);
    for (let y = near; y <= far; y++) this.line([[left * step, y * step, this.floor], [right * step, y * step, this.floor]], "#e3e9ee", 1);
    this.text(`squares of ${+step.toPrecision(3)} m`, 12, this.height - 12, GREY, "12px");
  }

  object(o, about) {
    const place = objectPlace(o), colour = colourOf(classesOf(o)), below = [place[0], place[1], this.floor];
    this.line([below, place], colour, 1, .45);
    this.disc(this.at(below), 2, colour, .45);
    this.ellipsoid(place, axesOf(objectAxes(o)), colour, 1);
    if (o[6] < .8) this.line([place, [place[0] + SMALL * this.size * Math.cos(o[2]), place[1] + SMALL * this.size * Math.sin(o[2]), place[2]]], colour, 3);
    this.disc(this.at(place), 6, "#fff", 1);
    this.disc(this.at(place), 4.6, colour, 1);
    if (about.true) this.cross(about.true);
  }

  cross(place) { // where an object truly is
    const [x, y] = this.at(place), c = 3.5, pen = this.pen;
    pen.beginPath();
    for (const side of [1, -1]) { pen.moveTo(x - c, y - side * c); pen.lineTo(x + c, y + side * c); }
    Object.assign(pen, { strokeStyle: INK, lineWidth: 1.6, globalAlpha: this.opacity });
    pen.stroke();
  }

  disc([x, y], radius, colour, alpha) {
    const pen = this.pen;
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    Object.assign(pen, { fillStyle: colour, globalAlpha: alpha * this.opacity });
    pen.fill();
  }

  ellipsoid(place, axes, colour, strength) { // its outline and its three circles; axes are one standard deviation long
    const [x, y, scale] = this.at(place), pen = this.pen;
    const flat = axes.map(axis => { const [right, up] = this.view(axis.map(value => value * SOLID)); return [scale * right, -scale * up]; });
    const sum = (m, n) => flat.reduce((total, axis) => total + axis[m] * axis[n], 0), [xx, xy, yy] = [sum(0, 0), sum(0, 1), sum(1, 1)];
    const middle = (xx + yy) / 2, radius = Math.hypot((xx - yy) / 2, xy), long = Math.sqrt(middle + radius), short = Math.sqrt(Math.max(middle - radius, 0));
    pen.beginPath();
    pen.ellipse(x, y, Math.max(long, .5), Math.max(short, .5), Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI);
    Object.assign(pen, { fillStyle: colour, strokeStyle: colour, lineWidth: 1.2, globalAlpha: .12 * strength * this.opacity });
    pen.fill();
    pen.globalAlpha = .9 * strength * this.opacity;
    pen.stroke();
    if (long < 8) return;
    for (const [m, n] of CIRCLES) {
      pen.beginPath();
      for (let k = 0; k <= 40; k++) {
        const c = Math.cos(k * Math.PI / 20), s = Math.sin(k * Math.PI / 20);
        pen.lineTo(x + c * flat[m][0] + s * flat[n][0], y + c * flat[m][1] + s * flat[n][1]);
      }
      Object.assign(pen, { lineWidth: .8, globalAlpha: .4 * strength * this.opacity });
      pen.stroke();
    }
  }

  camera(h, length, colour, width, alpha) { // a pyramid from its place to the corners of its picture
    const eye = scene.camera[0], deep = length * this.size;
    const [tip, ...corners] = scene.camera.map(p => turnedBy(h, p.map((value, n) => eye[n] + (value - eye[n]) * deep)));
    this.line([...corners, corners[0]], colour, width, alpha);
    for (const corner of corners) this.line([tip, corner], colour, width, alpha);
  }

  compass() { // where x, y and z of the map are
    const x = this.width - 34, y = this.height - 34;
    ["x", "y", "z"].forEach((name, n) => {
      const [right, up] = this.view([0, 1, 2].map(m => +(m === n))), pen = this.pen;
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + 18 * right, y - 18 * up);
      Object.assign(pen, { strokeStyle: GREY, lineWidth: 1.5, globalAlpha: 1 });
      pen.stroke();
      this.text(name, x + 26 * right - 3, y - 26 * up + 4, GREY, "12px");
    });
  }

  label([px, py], text) { // beside a point in view, within the canvas and where no other label stands
    if (px < 0 || py < 0 || px > this.width || py > this.height) return;
    this.pen.font = this.font("600 13px");
    const place = freePlace(px, py, this.pen.measureText(text).width, this.labels, this.width, this.height, 9);
    if (place) this.text(text, ...place, INK, "600 13px");
  }

  text(words, x, y, colour, size) {
    const pen = this.pen;
    Object.assign(pen, { font: this.font(size), fillStyle: colour, strokeStyle: "#fff", lineWidth: 3, globalAlpha: this.opacity, lineJoin: "round" });
    pen.strokeText(words, x, y);
    pen.fillText(words, x, y);
  }

  font(size) { return size + " " + getComputedStyle(this.canvas).fontFamily; }
}

function turnedBy(h, point) { // a point of the body, in map
  const v = turned(h.slice(9, 13), point);
  return placeOf(h).map((value, n) => value + v[n]);
}
