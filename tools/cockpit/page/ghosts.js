// The cars beside the visitor's: the same car at another place, as pale outlines.

import { colour } from "cockpit/theme.js";
import { drawOutline, write } from "cockpit/vehicle.js";

const GHOSTS = [
  { name: "ghost", ink: "wanted", label: "your car without delay" },
  { name: "predictor", ink: "applied", label: "the predictor behind the same delay" },
];
const LABEL_Y = 36, LINE = 18; // below the scale of the deviation

function shown(rows, at) {
  return GHOSTS.filter(({ name }) => Number.isFinite(rows.columns[`${name}_m`][at]));
}

// state: of the visitor's car, whose place on the path they share
export function drawGhosts(pen, facts, rows, at, factor, state) {
  for (const { name, ink } of shown(rows, at)) {
    const off = factor * rows.columns[`${name}_m`][at], heading = state.pathHeading + rows.columns[`${name}_heading_rad`][at];
    const x = state.footX - off * Math.sin(state.pathHeading), y = state.footY + off * Math.cos(state.pathHeading);
    pen.save();
    pen.globalAlpha = 0.45;
    drawOutline(pen, facts, colour(ink), { heading, x: x - facts.preview_m * Math.cos(heading), y: y - facts.preview_m * Math.sin(heading) });
    pen.restore();
  }
}

export function nameGhosts(pen, rows, at) {
  shown(rows, at).forEach(({ ink, label }, index) => {
    pen.fillStyle = colour(ink);
    write(pen, `▬ ${label}`, 12, LABEL_Y + LINE * index);
  });
}
