// The vehicle from above on its path, to scale; the path's direction at the vehicle is to the right.

import { colour, lawLine } from "cockpit/theme.js";
import { byId, length, pressed, setText } from "cockpit/words.js";
import { drawGhost, nameGhost } from "cockpit/ghost.js";
import { detailOf, drawSteer, drawVehicle, write } from "cockpit/vehicle.js";

const ROAD_M = 3.5;
const PATH_DASH_M = [0.8, 0.6];
const BEYOND_M = 1e5; // of an open path
const FAR_M = 0.3; // off the path: nothing beyond it is magnified
const TRAIL_S = 15, TRAIL_ROWS = 4;
const ZOOM_MIN = 3, ZOOM_MAX = 120, ZOOM_STEP = 1.3;

export class Scene {
  constructor(app) {
    this.app = app;
    this.canvas = byId("scene");
    this.pixelsPerM = 26;
    this.factor = 10;
    this.isWhole = false;
    byId("deviation").onclick = () => this.toggleFactor();
    byId("overview").onclick = () => this.toggleWhole();
    byId("zoom-in").onclick = () => this.zoom(ZOOM_STEP);
    byId("zoom-out").onclick = () => this.zoom(1 / ZOOM_STEP);
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(event.deltaY < 0 ? 1.12 : 1 / 1.12);
    }, { passive: false });
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }

  toggleFactor() {
    this.factor = this.factor === 1 ? 10 : 1;
    this.app.touch();
  }

  // The button tells what is drawn, which is not always what was asked for.
  tellFactor(factor) {
    pressed(byId("deviation"), factor > 1);
    setText(byId("deviation"), `Deviation ×${factor}`);
    byId("deviation").disabled = this.app.isDriven;
  }

  toggleWhole() {
    this.isWhole = !this.isWhole;
    pressed(byId("overview"), this.isWhole);
    byId("zoom-in").disabled = byId("zoom-out").disabled = this.isWhole;
    this.app.touch();
  }

  zoom(ratio) {
    this.pixelsPerM = Math.min(Math.max(this.pixelsPerM * ratio, ZOOM_MIN), ZOOM_MAX);
    this.app.touch();
  }

  resize() {
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.round(this.canvas.clientWidth * ratio);
    this.canvas.height = Math.round(this.canvas.clientHeight * ratio);
    this.app.touch();
  }

  drawNothing(why) {
    const pen = this.canvas.getContext("2d");
    const ratio = devicePixelRatio || 1;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = colour("ground");
    pen.fillRect(0, 0, this.canvas.clientWidth, this.canvas.clientHeight);
    if (why) say(pen, this.canvas.clientWidth, this.canvas.clientHeight, why);
    return pen;
  }

  draw(nowS) {
    const pen = this.drawNothing("");
    if (!this.canvas.clientHeight) return; // nothing has a scale there
    let drawn = 1;
    const places = viewports(this.app.lanes.length, this.canvas.clientWidth, this.canvas.clientHeight);
    places.forEach((place, lane) => {
      pen.save();
      pen.beginPath();
      pen.rect(place.x, place.y, place.width, place.height);
      pen.clip();
      pen.translate(place.x, place.y);
      drawn = Math.max(drawn, this.drawLane(pen, place, lane, nowS));
      pen.restore();
    });
    this.tellFactor(drawn);
  }

  // Returns how much the deviation is magnified.
  drawLane(pen, place, lane, nowS) {
    const rows = this.app.lanes[lane];
    const at = rows.indexAt(nowS);
    if (at < 0) return 1;
    const facts = this.app.head.lanes[lane];
    const factor = this.factorAt(rows, at, nowS);
    const state = stateAt(rows, at, factor, facts.preview_m);
    const camera = this.isWhole ? wholeCamera(place, facts, rows) : this.camera(place, state, facts);
    const world = () => pen.translate(camera.x, camera.y);
    pen.save();
    world();
    pen.scale(camera.scale, -camera.scale);
    pen.rotate(-camera.turn);
    pen.translate(-camera.atX, -camera.atY);
    if (!this.isWhole) drawGrid(pen, camera, this.reach(camera, place));
    drawPath(pen, camera, this.reach(camera, place), facts, rows, at);
    drawTrail(pen, rows, at, nowS - TRAIL_S, factor, facts.preview_m);
    inkAs(pen, lawLine(facts), 2 / camera.scale);
    drawGhost(pen, facts, rows, at, factor, state);
    // A car that has not begun stands at the start of its path; one that is out of sight is not drawn.
    const last = Number.isFinite(state.error) ? undefined : rows.columns.lateral_error_m.subarray(0, at).findLast(Number.isFinite);
    if (last === undefined) {
      drawVehicle(pen, facts, state, this.isWhole ? 3 : 1);
      drawDeviation(pen, camera, state);
    }
    pen.restore();
    if (last !== undefined) say(pen, place.width, place.height, `no measurement; the preview point was last ${length(last, this.app.isInMetres)} off the path`);
    this.drawLabels(pen, place, camera, lane, state);
    pen.fillStyle = colour("dim");
    const y = this.app.lanes.length > 1 ? 38 : 18; // below the name of the lane
    const why = this.app.isDriven ? "" : `: was beyond ${length(FAR_M, this.app.isInMetres)}`;
    write(pen, `deviation ×${factor}${factor < this.factor ? why : ""}`, 12, y);
    nameGhost(pen, rows, at);
    return factor;
  }

  // Magnified, a car that was far off would leave the picture with its road.
  factorAt(rows, at, nowS) {
    if (this.app.isDriven) return 1;
    const deviations = rows.columns.cg_deviation_m.subarray(Math.max(rows.indexAt(nowS - TRAIL_S), 0), at + 1);
    return deviations.some((deviation) => Math.abs(deviation) > FAR_M) ? 1 : this.factor;
  }

  camera(place, state, facts) {
    const farM = Math.hypot(state.x - state.besideX, state.y - state.besideY);
    const nearness = 1 / Math.sqrt(detailOf(facts)); // a small car is seen from nearby
    const wished = nearness * this.pixelsPerM * (this.app.lanes.length > 1 ? 0.62 : 1);
    const scale = Math.min(wished, (0.4 * place.height) / farM); // the road stays in the picture
    // The vehicle is left of the middle: what is ahead says more.
    return { x: 0.42 * place.width, y: 0.5 * place.height, scale, turn: state.pathHeading, atX: state.x, atY: state.y };
  }

  // How far from the camera something may be seen [m].
  reach(camera, place) {
    return this.isWhole ? Infinity : Math.hypot(place.width, place.height) / camera.scale;
  }

  drawLabels(pen, place, camera, lane, state) {
    pen.font = "12px system-ui, sans-serif";
    pen.textBaseline = "alphabetic";
    if (this.app.lanes.length > 1) {
      pen.strokeStyle = colour("line");
      pen.strokeRect(0.5, 0.5, place.width, place.height);
      const facts = this.app.head.lanes[lane];
      trace(pen, [[place.width - 44, 16], [place.width - 10, 16]]);
      inkAs(pen, lawLine(facts), 3);
      pen.fillStyle = colour("text");
      pen.textAlign = "right";
      write(pen, facts.label, place.width - 52, 20);
      pen.textAlign = "left";
    }
    drawScale(pen, place, camera);
    if (!this.isWhole) drawSteer(pen, place, state, this.app.lanes.length > 1);
    pen.fillStyle = colour("text");
    if (!this.isWhole && Number.isFinite(state.error)) {
      const off = `car ${length(state.deviation, this.app.isInMetres)}`;
      const tip = onScreen(camera, state.nameX, state.nameY);
      // Above the car where the scale of the steering would lie over it.
      const isAbove = state.deviation > 0 || this.app.lanes.length > 1;
      write(pen, off, tip.x + 12, tip.y + (isAbove ? -8 : 16));
    }
  }
}

// One viewport for each lane, as square as may be.
function viewports(count, width, height) {
  const columns = count < 3 && height > width * 0.55 ? 1 : Math.min(count, 2);
  const lines = Math.ceil(count / columns);
  return Array.from({ length: count }, (_, lane) => ({
    x: (lane % columns) * (width / columns), y: Math.floor(lane / columns) * (height / lines),
    width: width / columns, height: height / lines,
  }));
}

// Where the car is, its deviation from the path magnified, and the place of the path next to it.
function placeAt(rows, at, factor, previewM) {
  const read = (name) => rows.columns[name][at];
  const known = (name) => (Number.isFinite(read(name)) ? read(name) : 0);
  const pathHeading = read("path_heading_rad"), heading = pathHeading + known("heading_error_rad");
  const footX = read("foot_x_m"), footY = read("foot_y_m"); // of the preview point on the path
  const error = known("lateral_error_m");
  const deviation = Number.isFinite(read("cg_deviation_m")) ? read("cg_deviation_m") : error;
  const [leftX, leftY] = [-Math.sin(pathHeading), Math.cos(pathHeading)];
  const off = error + (factor - 1) * deviation;
  const x = footX + off * leftX - previewM * Math.cos(heading), y = footY + off * leftY - previewM * Math.sin(heading);
  return {
    pathHeading, heading, footX, footY, deviation, x, y,
    besideX: x - factor * deviation * leftX, besideY: y - factor * deviation * leftY,
    nameX: x + previewM * Math.cos(heading), nameY: y + previewM * Math.sin(heading),
  };
}

function stateAt(rows, at, factor, previewM) {
  const read = (name) => rows.columns[name][at];
  return {
    ...placeAt(rows, at, factor, previewM), error: read("lateral_error_m"),
    wanted: read("steer_rad"), inEffect: read("steer_in_effect_rad"), applied: read("wheel_angle_rad"),
  };
}

function drawTrail(pen, rows, at, fromS, factor, previewM) {
  const { lateral_error_m: error } = rows.columns;
  const first = Math.max(rows.indexAt(fromS), 0);
  pen.beginPath();
  for (let index = first - (first % TRAIL_ROWS); index <= at; index += TRAIL_ROWS) {
    if (!Number.isFinite(error[index])) {
      pen.beginPath(); // what was before is not the way of a car that was put back
      continue;
    }
    const { x, y } = placeAt(rows, index, factor, previewM);
    pen.lineTo(x, y);
  }
}

function wholeCamera(place, facts, rows) {
  const points = facts.path_m.length ? facts.path_m : pathSoFar(rows, rows.length - 1, 4);
  const xs = points.map((point) => point[0]), ys = points.map((point) => point[1]);
  const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const scale = Math.min((place.width - 60) / Math.max(right - left, 10), (place.height - 90) / Math.max(high - low, 10));
  return { x: place.width / 2, y: place.height / 2 + 12, scale, turn: 0, atX: (left + right) / 2, atY: (low + high) / 2 };
}

function pathSoFar(rows, at, step) {
  const points = [];
  for (let index = 0; index <= at; index += step) points.push([rows.columns.foot_x_m[index], rows.columns.foot_y_m[index]]);
  return points;
}

function drawGrid(pen, camera, reach) {
  const step = camera.scale > 12 ? 5 : 20;
  pen.strokeStyle = colour("grid");
  pen.lineWidth = 1 / camera.scale;
  pen.beginPath();
  const from = (value) => Math.floor((value - reach) / step) * step;
  for (let x = from(camera.atX); x < camera.atX + reach; x += step) {
    pen.moveTo(x, camera.atY - reach);
    pen.lineTo(x, camera.atY + reach);
  }
  for (let y = from(camera.atY); y < camera.atY + reach; y += step) {
    pen.moveTo(camera.atX - reach, y);
    pen.lineTo(camera.atX + reach, y);
  }
  pen.stroke();
}

function drawPath(pen, camera, reach, facts, rows, at) {
  const points = facts.path_m.length ? (facts.drawn_m ??= withEnd(facts)) : pathSoFar(rows, rows.isWhole ? rows.length - 1 : at, 3);
  pen.lineJoin = "round";
  for (const piece of piecesWithin(points, facts.path_is_closed, camera, reach)) {
    trace(pen, piece.points);
    ink(pen, colour("road-edge"), ROAD_M + 2 / camera.scale);
    ink(pen, colour("road"), ROAD_M);
    pen.setLineDash(PATH_DASH_M);
    pen.lineDashOffset = piece.fromM;
    ink(pen, colour("path"), 1.2 / camera.scale);
    pen.setLineDash([]);
  }
}

// An open path goes straight on behind its end.
function withEnd({ path_m: points, path_is_closed: isClosed }) {
  const [[fromX, fromY], [x, y]] = points.slice(-2);
  const far = BEYOND_M / Math.hypot(x - fromX, y - fromY);
  return isClosed ? points : [...points, [x + far * (x - fromX), y + far * (y - fromY)]];
}

// The pieces of a path that may be seen, each with its distance along the path.
function piecesWithin(points, isClosed, camera, reach) {
  const pieces = [];
  let piece = null, alongM = 0;
  const count = points.length + (isClosed ? 1 : 0);
  for (let index = 1; index < count; index++) {
    const from = points[index - 1], to = points[index % points.length];
    const lengthM = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const isNear = Math.hypot(from[0] - camera.atX, from[1] - camera.atY) < reach + lengthM;
    if (isNear && !piece) pieces.push((piece = { points: [from], fromM: alongM }));
    if (isNear) piece.points.push(to);
    else piece = null;
    alongM += lengthM;
  }
  return pieces;
}

function trace(pen, points) {
  pen.beginPath();
  for (const [x, y] of points) pen.lineTo(x, y);
}

function ink(pen, style, width) {
  pen.strokeStyle = style;
  pen.lineWidth = width;
  pen.stroke();
}

// The line of a law.
function inkAs(pen, { ink: style, dash }, width) {
  pen.setLineDash(dash.map((part) => (part * width) / 1.5));
  ink(pen, style, width);
  pen.setLineDash([]);
}

// Words in the middle of a picture.
function say(pen, width, height, text) {
  pen.font = "14px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.fillStyle = colour("text");
  write(pen, text, width / 2, height / 2 - 40);
  pen.textAlign = "left";
}

function drawDeviation(pen, camera, state) {
  const size = 4.5 / camera.scale;
  trace(pen, [[state.besideX, state.besideY], [state.x, state.y]]);
  ink(pen, colour("bad"), 2 / camera.scale);
  pen.fillStyle = colour("path");
  pen.fillRect(state.besideX - size / 2, state.besideY - size / 2, size, size);
  pen.beginPath();
  pen.arc(state.x, state.y, size, 0, 2 * Math.PI);
  pen.fillStyle = colour("bad");
  pen.fill();
}

function drawScale(pen, place, camera) {
  const steps = [1, 2, 5, 10, 20, 50, 100];
  const metres = steps.find((step) => step * camera.scale > 50) ?? 200;
  const [x, y, width] = [12, place.height - 12, metres * camera.scale];
  pen.strokeStyle = colour("dim");
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.moveTo(x, y - 4);
  pen.lineTo(x, y);
  pen.lineTo(x + width, y);
  pen.lineTo(x + width, y - 4);
  pen.stroke();
  pen.fillStyle = colour("dim");
  write(pen, `${metres} m`, x + 4, y - 6);
}

function onScreen(camera, x, y) {
  const [dx, dy] = [x - camera.atX, y - camera.atY];
  const [cos, sin] = [Math.cos(camera.turn), Math.sin(camera.turn)];
  return { x: camera.x + camera.scale * (dx * cos + dy * sin), y: camera.y - camera.scale * (dy * cos - dx * sin) };
}
