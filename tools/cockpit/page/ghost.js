// The car beside the visitor's, as the predictor steers it: a pale outline at its own place.

import { colour } from "cockpit/theme.js";
import { drawOutline, write } from "cockpit/vehicle.js";

const INK = "applied", LABEL_Y = 36; // below the scale of the deviation

function isShown(rows, at) {
  return Number.isFinite(rows.columns.ghost_m[at]);
}

// state: of the visitor's car, whose place on the path they share
export function drawGhost(pen, facts, rows, at, factor, state) {
  if (!isShown(rows, at)) return;
  const off = factor * rows.columns.ghost_m[at], heading = state.pathHeading + rows.columns.ghost_heading_rad[at];
  const x = state.footX - off * Math.sin(state.pathHeading), y = state.footY + off * Math.cos(state.pathHeading);
  pen.save();
  pen.globalAlpha = 0.45;
  drawOutline(pen, facts, colour(INK), { heading, x: x - facts.preview_m * Math.cos(heading), y: y - facts.preview_m * Math.sin(heading) });
  pen.restore();
}

export function nameGhost(pen, rows, at) {
  if (!isShown(rows, at)) return;
  pen.fillStyle = colour(INK);
  write(pen, "▬ the predictor behind the same delay", 12, LABEL_Y);
}
