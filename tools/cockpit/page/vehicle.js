// The vehicle's outline with wheels that steer, and the three steering angles next to each other.

import { colour } from "cockpit/theme.js";
import { fixed } from "cockpit/words.js";

const WIDTH_M = 1.78; // of the car whose details these are
const TRACK_M = 1.5;
const WHEEL_M = [0.64, 0.22];
const RAY_M = 2.6;

// In metres: the pen's x is to the east, y to the north.
export function drawVehicle(pen, facts, state, size) {
  pen.save();
  pen.translate(state.x, state.y);
  pen.rotate(state.heading);
  pen.scale(size, size);
  const front = facts.front_axle_m, rear = -facts.rear_axle_m, detail = detailOf(facts);
  for (const side of [-1, 1]) {
    drawWheel(pen, rear, side * detail, 0);
    drawWheel(pen, front, side * detail, known(state.applied));
  }
  traceBody(pen, facts);
  pen.fillStyle = colour("body");
  pen.globalAlpha = 0.9;
  pen.fill();
  pen.globalAlpha = 1;
  pen.lineWidth = 0.05 * detail;
  pen.strokeStyle = colour("body-line");
  pen.stroke();
  drawGlass(pen, front, rear, detail);
  if (size === 1) drawRays(pen, front, state);
  pen.restore();
}

// The body alone, for a car that is not there.
export function drawOutline(pen, facts, style, state) {
  pen.translate(state.x, state.y);
  pen.rotate(state.heading);
  traceBody(pen, facts);
  pen.fillStyle = style;
  pen.fill();
}

// How large the details of a car are.
export function detailOf({ body_m: [, , width] }) {
  return width / WIDTH_M;
}

function traceBody(pen, facts) {
  const [front, rear, width] = facts.body_m, detail = detailOf(facts);
  pen.beginPath();
  pen.roundRect(-rear, -width / 2, front + rear, width, [0.45, 0.75, 0.75, 0.45].map((radius) => radius * detail));
}

// side: of the car, times the size of its details
function drawWheel(pen, x, side, angle) {
  const detail = Math.abs(side);
  pen.save();
  pen.translate(x, (side * TRACK_M) / 2);
  pen.rotate(angle);
  pen.scale(detail, detail);
  pen.fillStyle = colour("text");
  pen.fillRect(-WHEEL_M[0] / 2, -WHEEL_M[1] / 2 + Math.sign(side) * 0.16, WHEEL_M[0], WHEEL_M[1]);
  pen.restore();
}

function drawGlass(pen, front, rear, detail) {
  const half = (inset) => (WIDTH_M / 2 - inset) * detail;
  pen.fillStyle = colour("glass");
  pen.beginPath();
  pen.roundRect(front - 1.15 * detail, -half(0.18), 0.5 * detail, 2 * half(0.18), [0.1, 0.2, 0.2, 0.1].map((radius) => radius * detail));
  pen.roundRect(rear + 0.1 * detail, -half(0.22), 0.34 * detail, 2 * half(0.22), 0.1 * detail);
  pen.fill();
}

// Where the wheels would point: the newest command, the one in effect, and the wheel itself.
function drawRays(pen, front, state) {
  const rays = [[state.applied, "applied", [], 0.12], [state.inEffect, "in-effect", [0.08, 0.1], 0.08], [state.wanted, "wanted", [0.2, 0.14], 0.06]];
  for (const [angle, ink, dash, width] of rays) {
    if (!Number.isFinite(angle)) continue;
    pen.beginPath();
    pen.moveTo(front, 0);
    pen.lineTo(front + RAY_M * Math.cos(angle), RAY_M * Math.sin(angle));
    pen.setLineDash(dash);
    pen.lineWidth = width;
    pen.strokeStyle = colour(ink);
    pen.stroke();
  }
  pen.setLineDash([]);
}

function known(angle) {
  return Number.isFinite(angle) ? angle : 0;
}

// With a rim, since the road may lie below.
export function write(pen, text, x, y) {
  pen.lineJoin = "round";
  pen.strokeStyle = colour("ground");
  pen.lineWidth = 4;
  pen.strokeText(text, x, y);
  pen.fillText(text, x, y);
}

const SCALES_RAD = [0.05, 0.1, 0.2, 0.4, 0.8, 1.6];

// The same three angles as marks on one scale, at the lower right of a viewport.
export function drawSteer(pen, place, state, isSmall) {
  const marks = [["wanted", state.wanted, "wanted"], ["in effect", state.inEffect, "in-effect"], ["applied", state.applied, "applied"]];
  const width = isSmall ? 110 : 190;
  const x = place.width - width - 14, bottom = place.height - 12;
  const largest = Math.max(...marks.map(([, angle]) => Math.abs(known(angle))));
  const end = SCALES_RAD.find((scale) => largest <= scale) ?? 1.6;
  const lines = isSmall ? 0 : 16;
  const top = bottom - 3 * lines - 22;
  pen.strokeStyle = colour("road-edge");
  pen.lineWidth = 1;
  pen.beginPath();
  for (const part of [0, 0.25, 0.5, 0.75, 1]) {
    pen.moveTo(x + part * width + 0.5, top + (part === 0.5 ? -6 : 0));
    pen.lineTo(x + part * width + 0.5, top + 6);
  }
  pen.moveTo(x, top + 6);
  pen.lineTo(x + width, top + 6);
  pen.stroke();
  pen.font = "11px system-ui, sans-serif";
  marks.forEach(([label, angle, ink], index) => {
    pen.fillStyle = colour(ink);
    if (Number.isFinite(angle)) drawMark(pen, x + width / 2 - (angle / end) * (width / 2), top + 6, index);
    if (isSmall) return;
    const text = Number.isFinite(angle) ? `${fixed(1000 * angle, 1)} mrad` : "–";
    write(pen, label, x + 16, top + 28 + index * lines);
    drawMark(pen, x + 5, top + 28 + index * lines, index);
    pen.textAlign = "right";
    write(pen, text, x + width, top + 28 + index * lines);
    pen.textAlign = "left";
  });
  pen.fillStyle = colour("dim");
  write(pen, isSmall ? `± ${1000 * end} mrad` : `left ${1000 * end}`, x, top - 9);
  if (isSmall) return;
  pen.textAlign = "right";
  write(pen, `right ${1000 * end} mrad`, x + width, top - 9);
  pen.textAlign = "left";
}

// A triangle, a diamond, a bar: told apart without colour.
function drawMark(pen, x, y, shape) {
  pen.beginPath();
  if (shape === 0) {
    pen.moveTo(x - 5, y - 10);
    pen.lineTo(x + 5, y - 10);
    pen.lineTo(x, y);
  } else if (shape === 1) {
    pen.moveTo(x, y - 9);
    pen.lineTo(x + 4.5, y - 4.5);
    pen.lineTo(x, y);
    pen.lineTo(x - 4.5, y - 4.5);
  } else pen.rect(x - 2, y - 10, 4, 10);
  pen.fill();
}
