const scene = JSON.parse(document.getElementById("scene").textContent);
const objectsAt = [];
for (const frame of scene.frames) objectsAt.push(objectsAfter(objectsAt.at(-1) || new Array(scene.objects.length).fill(null), frame));
const main = new MapView(document.getElementById("mainmap"), false);
const small = [...document.querySelectorAll(".map.small")].map(svg => ({ svg, view: new MapView(svg, true), frame: +svg.dataset.frame }));
const plots = plotsIn(document), canvas = document.getElementById("space"), space = canvas && new SpaceView(canvas);
const slider = document.getElementById("slider"), first = scene.frames[0].k, last = scene.frames.length - 1;
let shown = last;

function show(i) {
  shown = i = Math.min(Math.max(i, 0), last);
  const frame = scene.frames[i];
  slider.value = i;
  const moment = document.getElementById("moment");
  moment.replaceChildren();
  html(moment, "b", "", "Keyframe " + frame.k);
  moment.append(` of ${scene.frames[last].k}, ${frame.t.toFixed(1)} s`);
  main.draw(i);
  if (space) space.draw(i);
  panel(i);
  picture(i);
  for (const plot of plots) plot.point(frame.k, i, i < last);
}

function drawSmall() {
  for (const { svg, view, frame } of small) {
    view.draw(frame);
    const { k, n } = scene.frames[frame];
    svg.parentElement.querySelector("figcaption").textContent = `Keyframe ${k}: ${n} ${n === 1 ? "hypothesis" : "hypotheses"}`;
  }
}

let timer = 0;
const play = document.getElementById("play");
function stop() { clearInterval(timer); timer = 0; play.textContent = "▶"; play.setAttribute("aria-label", "play"); }
play.addEventListener("click", () => {
  if (timer) return stop();
  if (shown === last) show(0);
  play.textContent = "❚❚";
  play.setAttribute("aria-label", "pause");
  timer = setInterval(() => shown < last ? show(shown + 1) : stop(), Math.max(60, Math.min(300, 15000 / (last + 1))));
});
slider.addEventListener("input", () => { stop(); show(+slider.value); });
for (const plot of plots) plot.follow(keyframe => {
  stop();
  show(keyframe - first);
});
function answer() { // open what the address names
  const asked = document.getElementById(location.hash.slice(1));
  if (asked && asked.tagName === "DETAILS") { asked.open = true; asked.scrollIntoView(); }
}
addEventListener("hashchange", answer);
let width = 0;
function redraw() {
  if (width === document.body.clientWidth) return;
  width = document.body.clientWidth;
  show(shown);
  drawSmall();
}
addEventListener("resize", redraw);
redraw();
answer();
