"use strict";
// Seconds that are shown, milliseconds between two looks for new states, share of the noise floor
// at the end of a bar, seconds without a state after which the view says so.
const SHOWN = 20, DRAWN = 250, LARGEST = 4, SILENT = 3;
const SMALLEST_STEP = 0.5; // s between two samples from which a curve is interrupted
const cards = new Map();
let newest = null, number_of_newest = 0, heard = 0, paused = false;

const style = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const number = (value, digits = 3) => value === null ? "–" : value.toFixed(digits);

function makeCard(joint) {
  const card = document.createElement("section");
  card.className = "joint";
  card.innerHTML = '<h2></h2><div class="plot"></div><div class="meter"><b></b><s></s><u></u></div><p></p>';
  card.querySelector("h2").append(joint.name, document.createElement("span"));
  document.getElementById("joints").append(card);
  const kept = {card, time: [], measured: [], predicted: [], residual: [], unit: ""};
  cards.set(joint.name, kept);
  return kept;
}

function keep(view) {
  for (const joint of view.joints) {
    const kept = cards.get(joint.name) || makeCard(joint);
    kept.joint = joint;
    if (view.reason) continue;
    const last = kept.time[kept.time.length - 1];
    if (last !== undefined && view.stamp < last) { // the clock was set back
      for (const key of ["time", "measured", "predicted", "residual"]) kept[key] = [];
    }
    if (last !== undefined && view.stamp - last > SMALLEST_STEP) push(kept, last + 1e-3, {});
    push(kept, view.stamp, joint);
    while (kept.time.length && kept.time[0] < view.stamp - SHOWN) {
      for (const key of ["time", "measured", "predicted", "residual"]) kept[key].shift();
    }
  }
}

function push(kept, time, joint) {
  kept.time.push(time);
  for (const key of ["measured", "predicted", "residual"]) kept[key].push(joint[key] ?? null);
}

function draw() {
  say();
  if (paused || newest === null) return;
  for (const kept of cards.values()) { drawMeter(kept); drawPlot(kept); }
}

function say() {
  const status = document.getElementById("status");
  const silent = (performance.now() - heard) / 1000;
  let text = "waiting for the first prediction", problem = false;
  if (newest !== null) {
    document.getElementById("robot").textContent = newest.robot || "Live efforts";
    document.title = `${newest.robot || "robot"}: live efforts`;
    problem = Boolean(newest.reason) || silent > SILENT;
    text = newest.reason ? `nothing is predicted: ${newest.reason}`
      : `effort at the joints, ${number(newest.delay, 2)} s behind the robot`;
    if (silent > SILENT) text = `nothing heard for ${silent.toFixed(0)} s: has idim-iv watch ended?`;
    if (paused) text += " (paused)";
    const nodes = document.getElementById("nodes");
    nodes.replaceChildren(...Object.entries(newest.nodes).flatMap(([name, what]) => {
      const term = document.createElement("dt"), words = document.createElement("dd");
      term.textContent = name; words.textContent = what;
      return [term, words];
    }));
  }
  status.textContent = text;
  status.className = problem ? "problem" : "";
}

function drawMeter({card, joint}) {
  card.className = `joint ${joint.level}`;
  const share = joint.share === null ? "no motion" : `${joint.share.toFixed(2)}× in the last second`;
  card.querySelector("span").textContent = share;
  const width = share => `${100 * Math.min(share / LARGEST, 1)}%`;
  card.querySelector("b").style.width = joint.level_share === null ? "0" : width(joint.level_share);
  const limit = card.querySelector("u");
  limit.hidden = joint.limit === null;
  if (joint.limit !== null) limit.style.left = `calc(${width(joint.limit)} - 2px)`;
  card.querySelector("p").textContent = joint.sentence;
}

function drawPlot(kept) {
  const end = newest.stamp, x = kept.time.map(time => time - end);
  const line = (key, axis, width) => ({
    x, y: kept[key], yaxis: axis, name: key, mode: "lines", connectgaps: false,
    line: {color: style(`--${key}`), width},
    hovertemplate: `%{y:.3f} ${kept.joint.unit}<extra>${key}</extra>`,
  });
  const axis = {gridcolor: style("--line"), zerolinecolor: style("--line"), tickfont: {size: 10}, automargin: true, nticks: 4};
  Plotly.react(kept.card.querySelector(".plot"), [
    line("measured", "y", 1.8), line("predicted", "y", 1.8), line("residual", "y2", 1.2),
  ], {
    margin: {l: 40, r: 6, t: 6, b: 24}, showlegend: false, hovermode: "x unified",
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: {color: style("--soft"), size: 11},
    hoverlabel: {bgcolor: style("--card"), font: {color: style("--ink")}},
    xaxis: {...axis, range: [-SHOWN, 0], ticksuffix: " s", anchor: "y2", tickvals: [-15, -10, -5, 0]},
    yaxis: {...axis, domain: [0.36, 1], title: {text: kept.joint.unit, standoff: 4}},
    yaxis2: {...axis, domain: [0, 0.26], nticks: 3},
  }, {displayModeBar: false, responsive: true});
}

document.getElementById("pause").addEventListener("click", event => {
  paused = !paused;
  event.target.textContent = paused ? "Go on" : "Pause";
  event.target.setAttribute("aria-pressed", String(paused));
});
async function ask() {
  try {
    const answer = await (await fetch(`states?after=${number_of_newest}`)).json();
    number_of_newest = answer.newest;
    for (const state of answer.states) {
      newest = state;
      heard = performance.now();
      if (!paused) keep(newest);
    }
  } catch { /* the server has ended: what was heard last stays, and `say` tells its age */ }
  draw();
  setTimeout(ask, DRAWN);
}
ask();
