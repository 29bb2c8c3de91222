"use strict";
const PACE_MS = 400, SLOW_MS = 2000, CHARTS_MS = 1000, QUIET_S = 5, MOST_TRUTH = 2000, MOST_PICTURES = 150;
let scene, objectsAt, main, space, plots = [], session = "", version = 0, shown = -1, follows = true, charted = [], drawnAt = 0;
const part = id => document.getElementById(id);

function forget() { // another run begins
  scene = { classes: [], objects: [], frames: [], truth: [], dead: [], crosses: [], pictures: [], extent: [] };
  objectsAt = [];
  charted = [];
  shown = -1;
  follows = true;
  drawnAt = 0;
  space = space || new SpaceView(part("space"));
  space.low = null;
  part("charts").replaceChildren();
  plots = [];
  document.body.className = "empty";
}

function take(data) { // what is new since the last time
  const last = scene.frames.at(-1);
  if (data.session === session && last && data.first > last.k) { // away for too long: from the start
    session = "";
    version = 0;
    return;
  }
  if (data.session !== session) forget();
  session = data.session;
  version = data.version;
  for (const [place, entry] of data.objects) scene.objects[place] = entry;
  data.frames.forEach(takeFrame);
  while (scene.frames.length && scene.frames[0].k < data.first) {
    scene.frames.shift();
    objectsAt.shift();
    shown--;
  }
  scene.truth = [...scene.truth, ...data.truth].slice(-MOST_TRUTH);
  const newer = new Set(data.pictures.map(p => p.k));
  scene.pictures = [...scene.pictures.filter(p => !newer.has(p.k)), ...data.pictures].slice(-MOST_PICTURES);
  scene.classes = data.classes;
  scene.crosses = data.crosses;
  if (!scene.camera !== !data.camera) {
    part("space").hidden = !data.camera;
    part("space").parentElement.classList.toggle("spatial", !!data.camera);
    scene.extent = [];
  }
  scene.camera = data.camera;
  if (scene.frames.length && "" + data.extent !== "" + scene.extent) {
    scene.extent = data.extent;
    fit();
  }
  tell(data);
  if (scene.frames.length && (data.frames.length || data.pictures.length || data.truth.length)) show(follows ? Infinity : shown);
  if (data.frames.length) later(drawCharts);
}

function fit() { // the map into the window
  document.body.className = "";
  const svg = part("mainmap");
  main = new MapView(svg, false, svg.clientHeight / svg.clientWidth || 0);
}

function takeFrame(frame) {
  const last = scene.frames.at(-1);
  if (!last || frame.k > last.k) {
    scene.frames.push(frame);
    objectsAt.push(objectsAfter(objectsAt.at(-1) || [], frame));
  } else { // a hypothesis of it came to be drawn
    const place = scene.frames.findIndex(known => known.k === frame.k);
    if (place >= 0) scene.frames[place] = frame;
  }
}

function show(i) {
  const last = scene.frames.length - 1;
  shown = i = Math.min(Math.max(i, 0), last);
  const frame = scene.frames[i], moment = part("moment");
  part("slider").max = last;
  part("slider").value = i;
  part("follow").setAttribute("aria-pressed", follows);
  moment.replaceChildren();
  html(moment, "b", "", "Keyframe " + frame.k);
  moment.append(` of ${scene.frames[last].k}, ${frame.t.toFixed(1)} s`);
  main.draw(i);
  if (scene.camera) space.draw(i);
  panel(i);
  picture(i);
  tiles(i, frame);
  const place = follows ? charted.length - 1 : charted.indexOf(frame.k); // they are drawn a little later
  for (const plot of plots) plot.point(frame.k, place, !follows && place >= 0);
}

function tiles(i, frame) {
  const faint = new Map(frame.e), objects = objectsAt[i].filter((o, place) => o && (faint.get(place) ?? 1) >= .5).length;
  const share = value => value === null ? "–" : percent(value);
  const values = [[frame.k, frame.t.toFixed(0) + " s"], [frame.n, frame.num_candidates + " weighed"], [objects, ""],
    [frame.association_entropy === null ? "–" : frame.association_entropy.toFixed(2), "nats"], [share(frame.unexplained), ""],
    [share(frame.discarded_mass_window), share(frame.discarded_mass) + " since the start"], [frame.dropped, ""]];
  document.querySelectorAll("#tiles dd").forEach((tile, n) => {
    tile.textContent = values[n][0];
    html(tile, "small", "", values[n][1]);
  });
  part("faint").hidden = !frame.e.length;
  part("movers").hidden = !frame.m;
  part("places").hidden = !frame.p;
}

function tell({ state, run, health, dropped }) { // how the run goes, and its nodes
  const [kind, text] = stateOf(state);
  part("state").className = "state " + kind;
  part("state").textContent = text;
  part("run").textContent = [run.source, run.id && "run " + run.id.slice(0, 12), run.revision].filter(word => word).join(" · ");
  part("lost").hidden = !state.lost;
  part("unknown").hidden = state.lost !== null;
  part("truth").hidden = !scene.truth.length;
  part("crosses").hidden = !scene.crosses.length;
  const last = scene.frames.at(-1), legend = part("classes");
  document.title = last ? `${last.k} · semantic SLAM` : "semantic SLAM";
  const own = scene.classes.filter(c => !c.shared), other = scene.classes.find(c => c.shared);
  const coloured = other ? [...own, { name: "other classes", colour: other.colour }] : own, key = JSON.stringify(coloured);
  if (legend.key !== key) {
    legend.key = key;
    legend.replaceChildren();
    for (const { name, colour } of coloured) {
      const entry = html(legend, "span");
      html(entry, "i", "sw class").style.background = colour;
      entry.append(name);
    }
  }
  const wrong = health.filter(status => status.level && status.silent === null), others = health.filter(status => !wrong.includes(status));
  const fine = others.filter(status => status.silent === null).length, silent = others.length - fine;
  part("alarm").hidden = !wrong.length;
  part("alarm").textContent = wrong.length === 1 ? wrong[0].message : wrong.length + " things are wrong with the nodes";
  table("health", wrong, statusRow, health.length ? "nothing is wrong" : "no diagnostics so far");
  table("fine", others, statusRow, "");
  part("others").hidden = !others.length;
  part("others").firstElementChild.textContent = [fine && fine + " fine", silent && silent + " silent"].filter(word => word).join(", ");
  table("dropped", dropped, (row, [node, reason, count]) => {
    html(row, "td", "", node);
    html(row, "td", "", reason);
    html(row, "td", "num", count);
  }, "nothing");
}

function statusRow(row, { name, level, message, silent }) {
  const cell = html(row, "td");
  row.className = silent === null ? "" : "silent";
  html(cell, "i", "dot " + (silent !== null ? "silent" : ["", "warn", "error"][Math.min(level, 2)]));
  cell.append(name);
  html(row, "td", "", silent === null ? message : `silent for ${silent} s; last: ${message}`);
}

function stateOf({ topic, publishers, age, ended, repeated, missed }) {
  const gaps = missed ? `, ${missed} missed` : "";
  if (age === null) return ["waiting", `waiting for ${topic}: ` + (publishers ? "it has a publisher that sends nothing yet" : "nobody publishes it")];
  if (ended) return ["", "this run has ended"];
  if (repeated !== null) return ["waiting", `known keyframes come again, now ${repeated}`];
  if (!publishers) return ["gone", `nobody publishes ${topic} any more, since ${age.toFixed(0)} s` + gaps];
  return age > QUIET_S ? ["waiting", `no keyframe for ${age.toFixed(0)} s` + gaps] : ["live", "live" + gaps];
}

function table(id, rows, fill, none) {
  const body = part(id).tBodies[0];
  body.replaceChildren();
  for (const row of rows) fill(html(body, "tr"), row);
  if (!rows.length) html(html(body, "tr"), "td", "muted", none);
}

function later(draw) { // at most once in so long
  const wait = Math.max(0, drawnAt + CHARTS_MS - performance.now());
  if (drawnAt === Infinity) return;
  drawnAt = Infinity;
  setTimeout(draw, wait);
}

async function drawCharts() {
  try {
    const of = session, data = await (await fetch("/charts")).json();
    if (of !== session) return;
    charted = data.keyframes;
    part("charts").replaceChildren(...new DOMParser().parseFromString(data.html, "text/html").body.childNodes);
    plots = plotsIn(part("charts"));
    for (const plot of plots) plot.follow(keyframe => look(scene.frames.findIndex(frame => frame.k >= keyframe)));
    show(follows ? Infinity : shown);
  } catch { // told by the next poll
  } finally {
    drawnAt = performance.now();
  }
}

function look(i) { // at one keyframe; at the newest one the page follows the run again
  if (i < 0) return;
  follows = i >= scene.frames.length - 1;
  show(i);
}

async function poll() {
  let wait = PACE_MS;
  try {
    if (!document.hidden || !version) take(await (await fetch(`/changes?session=${session}&version=${version}`)).json());
  } catch (fault) {
    part("state").className = "state gone";
    part("state").textContent = "the view does not answer: has it ended? semantic_slam view starts it again";
    wait = SLOW_MS;
    console.error(fault);
  }
  setTimeout(poll, wait);
}

part("slider").addEventListener("input", event => look(+event.target.value));
part("follow").addEventListener("click", () => look(scene.frames.length - 1));
addEventListener("resize", () => {
  if (!scene.frames.length) return;
  fit();
  show(follows ? Infinity : shown);
});
forget();
poll();
