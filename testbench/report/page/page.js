"use strict";

const drawn = JSON.parse(document.getElementById("data").textContent);
const scenePlace = document.getElementById("scene");
const scene = drawn.scene ? new Scene(scenePlace, drawn.scene) : null;
if (scene) document.querySelectorAll(".pictures details").forEach((own) => (own.open = false)); // a page without scripts has them open

/** Show the arm in a pose, and bring it into view. */
function choose(group, pose) {
  if (!scene) return;
  scene.show(group, pose);
  scenePlace.scrollIntoView({ block: "nearest", behavior: "smooth" });
}

for (const table of document.querySelectorAll("table")) sortable(table);
for (const place of document.querySelectorAll(".chart")) dotChart(place, drawn.tables[place.dataset.table]);
for (const place of document.querySelectorAll(".runs")) {
  const chart = drawn.runs[place.dataset.runs];
  runChart(place, chart, drawn.scene.groups[chart.group].names, choose);
}
if (drawn.map) new Maps(document.getElementById("map"), drawn.map, drawn.ramp, choose);
document.documentElement.dataset.ready = Math.round(performance.now());
