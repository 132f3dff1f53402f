// The strip charts: one uPlot each, on one time axis, with one cursor and one zoom.

import { asFill, colour, lawLine } from "cockpit/theme.js";
import { byId, element, fixed, setText, shown } from "cockpit/words.js";

const SPANS_S = [5, 15, 30, 60];
const SIGNAL_STYLES = {
  steer_rad: ["wanted", [5, 3]],
  steer_in_effect_rad: ["in-effect", [2, 2]],
  wheel_angle_rad: ["applied", []],
  cg_deviation_m: ["second", [5, 3]],
  uplink_s: ["second", [5, 3]],
  driver_torque_n_m: ["wanted", [5, 3]],
};
const STEP_PIXELS = 2; // to draw them again for less would show nothing more
const FONT = "11px system-ui, sans-serif";

export class Charts {
  // app: what main.js has; its nowS is the right end of the charts unless they are zoomed
  constructor(app) {
    this.app = app;
    this.box = byId("charts");
    this.spanIndex = 1;
    this.zoom = null; // [from, to] of a part that was selected
    this.drawnS = 0;
    this.plots = [];
    this.chosen = {}; // by the title of a chart: a signal in place of its own, and a fixed scale
    byId("span-less").onclick = () => this.changeSpan(-1);
    byId("span-more").onclick = () => this.changeSpan(1);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.box);
  }

  get spanS() {
    return SPANS_S[this.spanIndex];
  }

  changeSpan(step) {
    this.spanIndex = Math.min(Math.max(this.spanIndex + step, 0), SPANS_S.length - 1);
    setText(byId("span"), `${this.spanS} s`);
    this.setZoom(null);
  }

  // Keep the scales that were chosen when lengths have another unit.
  rescale(ratioOf) {
    for (const [title, chosen] of Object.entries(this.chosen)) {
      const chart = this.app.head.charts.find((one) => one.title === title);
      if (chosen.high !== null) chosen.high *= ratioOf(chosen.signal || chart.of_lanes);
    }
  }

  // Make the charts again: other lanes, or other colours.
  build() {
    for (const { plot } of this.plots) plot.destroy();
    this.box.replaceChildren();
    this.plots = this.app.head.charts.map((chart, index, all) =>
      this.makeChart(chart, index === all.length - 1),
    );
    this.resize();
  }

  linesOf(chart) {
    const signals = this.app.signals, chosen = this.chosen[chart.title].signal;
    if (this.app.lanes.length > 1) {
      return this.app.lanes.map((rows, lane) => ({
        rows, signal: signals[chosen || chart.of_lanes], label: this.app.head.lanes[lane].label,
        ...lawLine(this.app.head.lanes[lane]),
      }));
    }
    return (chosen ? [chosen] : chart.signals).map((name) => {
      const [ink, dash] = SIGNAL_STYLES[name] ?? ["first", []];
      return { rows: this.app.lanes[0], signal: signals[name], label: signals[name].label, ink: colour(ink), dash };
    });
  }

  // What a chart shows: its own signals, or another one.
  signalBox(chart) {
    const { signal } = this.chosen[chart.title];
    const others = Object.values(this.app.signals).map(({ name, label, unit }) => element("option", { value: name, selected: name === signal }, unit ? `${label} [${unit}]` : label));
    const box = element("select", { ariaLabel: `${chart.title}: signal`, onchange: () => {
      this.chosen[chart.title] = { signal: box.value, high: null };
      this.build();
    } }, element("option", { value: "", selected: !signal }, `${chart.title} [${this.app.signals[chart.of_lanes].unit}]`), ...others);
    return box;
  }

  // The end of a fixed scale, to either side; empty for one that follows the values.
  scaleBox(chart) {
    const box = element("input", { type: "number", min: 0, step: "any", placeholder: "auto", value: this.chosen[chart.title].high ?? "", title: "Scale to this value on either side", ariaLabel: `${chart.title}: scale`, onchange: () => {
      this.chosen[chart.title].high = box.valueAsNumber > 0 ? box.valueAsNumber : null;
      this.app.touch();
    } });
    return element("label", { className: "scale" }, "±", box);
  }

  makeChart(chart, isLast) {
    this.chosen[chart.title] ??= { signal: "", high: null };
    const lines = this.linesOf(chart);
    const unit = lines[0]?.signal.unit ?? "";
    const values = lines.map((line) => {
      const key = element("span", { className: "key", title: line.label }, element("span", { className: this.app.lanes.length > 1 ? "of-lane" : "" }, `${line.label} `), element("b"));
      key.style.setProperty("--fill", asFill(line));
      return key;
    });
    const place = element("div", { className: "plot" });
    const shownBox = element("div", { className: "values" }, ...values);
    const title = element("h2", {}, this.signalBox(chart));
    const box = element("div", { className: `chart${isLast ? " last" : ""}`, role: "group", ariaLabel: `${chart.title}, ${unit}` },
      element("div", { className: "chart-head" }, title, this.scaleBox(chart), shownBox), place);
    this.box.append(box);
    this.observer.observe(shownBox); // what it says of a span takes room from the plot
    const plot = new uPlot(this.options(chart, lines, isLast), [[], ...lines.map(() => [])], place);
    return { plot, lines, place, values: values.map((value) => value.querySelector("b")) };
  }

  options(chart, lines, isLast) {
    const axis = { stroke: colour("dim"), font: FONT, grid: { stroke: colour("line"), width: 1 }, ticks: { show: false } };
    return {
      width: 300, height: 80, padding: [5, 10, isLast ? 0 : 4, 0], legend: { show: false },
      cursor: { sync: { key: "cockpit" }, drag: { x: true, y: false, setScale: false }, points: { size: 5 } },
      scales: { x: { time: false }, y: { range: (_plot, low, high) => this.rangeOf(chart, low, high) } },
      series: [{}, ...lines.map(({ ink, dash }) => ({ stroke: ink, width: 1.4, dash, points: { show: false } }))],
      axes: [
        { ...axis, size: isLast ? 22 : 0, gap: 2, values: (_plot, marks) => marks.map((mark) => (isLast && mark >= 0 ? `${+mark.toFixed(3)} s` : "")) },
        { ...axis, size: 46, gap: 4, space: 22, values: (_plot, marks) => marks.map((mark) => String(+mark.toFixed(6)).replace("-", "−")) },
      ],
      hooks: { setSelect: [(plot) => this.select(plot)], ready: [(plot) => this.listen(plot)] },
    };
  }

  rangeOf(chart, low, high) {
    const end = this.chosen[chart.title].high;
    return end === null ? wide(low, high) : [-end, end];
  }

  listen(plot) {
    plot.over.addEventListener("dblclick", () => this.setZoom(null));
  }

  select(plot) {
    if (plot.select.width < 4) return;
    const from = plot.posToVal(plot.select.left, "x");
    const to = plot.posToVal(plot.select.left + plot.select.width, "x");
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.setZoom([from, to]);
  }

  setZoom(zoom) {
    this.zoom = zoom;
    this.box.classList.toggle("spanned", zoom !== null); // there is more to read of a span
    this.resize();
  }

  resize() {
    for (const { plot, place } of this.plots) {
      const { clientWidth: width, clientHeight: height } = place;
      if (width > 40 && height > 20) plot.setSize({ width, height });
    }
    this.app.touch();
  }

  // Whether the charts have moved on by enough to be seen.
  isDue(nowS) {
    const width = Math.max(...this.plots.map(({ plot }) => plot.bbox.width)) / devicePixelRatio;
    return Math.abs(nowS - this.drawnS) * width >= STEP_PIXELS * this.spanS;
  }

  draw(nowS) {
    this.drawnS = nowS;
    const [from, to] = this.zoom ?? [nowS - this.spanS, nowS];
    const longest = this.app.lanes.reduce((one, other) => (other.endS > one.endS ? other : one));
    const times = timesOf(longest, from, to);
    for (const { plot, lines, values } of this.plots) {
      const data = lines.map(({ rows, signal }) => columnAt(rows, signal, times));
      plot.batch(() => {
        plot.setData([times, ...data], false);
        plot.setScale("x", { min: from, max: to });
      });
      const cursor = plot.cursor.idx;
      values.forEach((value, index) => {
        const { rows, signal } = lines[index];
        const at = cursor == null ? nowS : times[cursor];
        const text = this.zoom && cursor == null ? statistics(signal, data[index]) : shown(signal, rows.value(signal.name, at));
        setText(value, text);
      });
    }
  }
}

// Mean, root mean square and extremes of the part that was selected.
function statistics(signal, column) {
  const values = column.filter((value) => value !== null);
  if (!values.length) return "–";
  const mean = (of) => values.reduce((sum, value) => sum + of(value), 0) / values.length;
  const figures = [mean((value) => value), Math.sqrt(mean((value) => value * value)), Math.min(...values), Math.max(...values)];
  const [average, rms, least, most] = figures.map((value) => fixed(value, signal.digits));
  return `mean ${average}, RMS ${rms}, ${least} to ${most}`;
}

function timesOf(rows, from, to) {
  return Array.from(rows.time.subarray(Math.max(rows.indexAt(from), 0), rows.indexAt(to) + 1));
}

// The values of a signal at rising times, as shown; null where there is none.
function columnAt(rows, signal, times) {
  const column = rows.columns[signal.name];
  let at = times.length ? rows.indexAt(times[0]) : -1;
  return times.map((time) => {
    while (at + 1 < rows.length && rows.time[at + 1] <= time) at++;
    const value = at < 0 || time > rows.endS ? NaN : column[at];
    return Number.isFinite(value) ? signal.scale * value : null;
  });
}

// The range of the values with some air, and never a range of nothing.
function wide(low, high) {
  if (low == null || high == null) return [0, 1];
  const air = Math.max(0.08 * (high - low), 0.02 * Math.max(Math.abs(low), Math.abs(high)), 0.05);
  return [low >= 0 && low - air < 0 ? 0 : low - air, high + air];
}
