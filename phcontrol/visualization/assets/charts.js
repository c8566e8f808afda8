// Charts of the run's signals: which are shown is chosen from lists, and time is common to all of them.
"use strict";

const LEAST = 1e-9;  // of a range that is shown, in the unit of the signal

function readable(number) {
  const size = Math.abs(number);
  return size !== 0 && (size < 1e-3 || size >= 1e5) ? number.toExponential(2) : number.toPrecision(4);
}

function short(number) {
  const size = Math.abs(number);
  return size !== 0 && (size < 1e-2 || size >= 1e4) ? number.toExponential(1) : number.toPrecision(3);
}

/** Round numbers between two others, about as many as wanted, and three at least. */
function ticksOf(low, high, wanted) {
  const found = evenTicks(low, high, wanted);
  return found.ticks.length >= 3 || wanted > 12 ? found : ticksOf(low, high, wanted + 1);
}

function evenTicks(low, high, wanted) {
  const rough = (high - low) / wanted, power = Math.pow(10, Math.floor(Math.log10(rough)));
  const step = power * [1, 2, 5, 10].find((part) => part * power >= rough * 0.999);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step && ticks.length < 50; k++) ticks.push(k * step);
  return { ticks, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), step };
}

function tickText(value, scale) {
  if (Math.abs(value) < 1e-9 * scale.step) return "0";
  return scale.step < 1e-3 || scale.step >= 1e4 ? value.toExponential(0) : value.toFixed(Math.min(scale.digits, 4));
}

const BRIGHT = { "#0072b2": "#4aa8e0", "#d55e00": "#ff8c3a", "#009e73": "#2fc89b", "#56b4e9": "#b5e3ff", "#7a5195": "#b79aff",
                 "#6b705c": "#aeb4a0", "#7f7f7f": "#b4b4b4", "#b01515": "#ff6b6b" };  // on a dark page

/** A canvas ready to be drawn on, at the screen's own resolution: its pen and its width. */
function cleared(canvas, heightOf) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth || 266, height = heightOf(width);
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return [pen, width, height];
}

/** Charts in a box, of all runs over each other. seek(t) is called where the user points at a time; first are the groups shown at first. */
function makeCharts(tracks, box, { seek, isDark, first }) {
  const HEIGHT = 118, LEFT = 46, RIGHT = 8, TOP = 6, BOTTOM = 18, several = tracks.length > 1;
  const groups = {};  // of signals, each with its column in every run that has it
  for (const { run, columns, number } of tracks) run.signals.forEach((signal, i) => {
    const group = (groups[signal.group] = groups[signal.group] || []);
    let known = group.find((each) => each.label === signal.label && each.unit === signal.unit);
    if (!known) {
      known = { ...signal, columns: {}, low: Infinity, high: -Infinity, shown: true };
      group.push(known);
    }
    known.columns[number] = columns.signals + i;
  });
  const charts = [];
  let view = null;  // [from, to] of the time axis; null for all of it
  let hover = null;

  const make = (kind, properties, ...children) => {
    const made = Object.assign(document.createElement(kind), properties);
    made.append(...children);
    return made;
  };

  function note({ number }, frame) {
    for (const group of Object.values(groups)) for (const signal of group) {
      if (!(number in signal.columns)) continue;
      const value = frame[signal.columns[number]];
      if (value < signal.low) signal.low = value;
      if (value > signal.high) signal.high = value;
    }
  }

  function titleOf(group) {
    return group + " [" + [...new Set(groups[group].map((signal) => signal.unit))].join(", ") + "]";
  }

  function add(name) {
    const chart = { group: name };
    chart.choice = make("select", { title: "what this chart shows" },
      ...Object.keys(groups).map((group) => make("option", { value: group, textContent: titleOf(group) })));
    chart.choice.setAttribute("aria-label", "what this chart shows");
    chart.choice.value = name;
    chart.close = make("button", { type: "button", textContent: "×", title: "remove this chart", className: "small" });
    chart.close.setAttribute("aria-label", "remove this chart");
    chart.legend = make("div", { className: "legend" });
    chart.canvas = make("canvas", { tabIndex: -1 });
    chart.canvas.setAttribute("role", "img");
    chart.box = make("section", { className: "chart" },
      make("div", { className: "chart-head" }, chart.choice, chart.close), chart.legend, chart.canvas);
    chart.choice.addEventListener("change", () => { chart.group = chart.choice.value; fillLegend(chart); redraw(); });
    chart.close.addEventListener("click", () => { charts.splice(charts.indexOf(chart), 1); chart.box.remove(); });
    listenTo(chart);
    fillLegend(chart);
    charts.push(chart);
    box.append(chart.box);
    return chart;
  }

  function fillLegend(chart) {
    chart.rows = groups[chart.group].map((signal) => {
      const mark = make("i", {}), numbers = tracks.map(() => make("b", {}));
      const row = make("button", { type: "button", className: "value", title: "show or hide " + signal.label },
        make("span", {}, mark, signal.label), ...numbers);
      row.addEventListener("click", () => { signal.shown = !signal.shown; redraw(); });
      return { signal, row, mark, numbers };
    });
    const head = several ? [make("div", { className: "value head" }, make("span", {}), ...tracks.map(dashOf))] : [];
    chart.legend.replaceChildren(...head, ...chart.rows.map((entry) => entry.row));
    chart.legend.classList.toggle("several", several);
    chart.legend.classList.toggle("two", chart.rows.length > 3 && !several);
    chart.canvas.setAttribute("aria-label", chart.group + " over time: " +
      groups[chart.group].map((signal) => signal.label + " in " + signal.unit).join(", "));
  }

  const whole = () => [Math.min(...tracks.map((track) => track.start)), Math.max(...tracks.map((track) => track.end))];

  function span() {
    const [start, end] = whole();
    return view || [start, end > start ? end : start + 1];
  }

  function timeAt(chart, event) {
    const pane = chart.canvas.getBoundingClientRect(), [from, to] = span();
    const part = (event.clientX - pane.left - LEFT) / (pane.width - LEFT - RIGHT);
    return from + Math.min(1, Math.max(0, part)) * (to - from);
  }

  function listenTo(chart) {
    const canvas = chart.canvas;
    let held = false;
    canvas.addEventListener("pointerdown", (event) => { held = true; canvas.setPointerCapture(event.pointerId); seek(timeAt(chart, event)); });
    canvas.addEventListener("pointerup", () => { held = false; });
    canvas.addEventListener("pointermove", (event) => {
      hover = timeAt(chart, event);
      if (held) seek(hover); else redraw();
    });
    canvas.addEventListener("pointerleave", () => { hover = null; redraw(); });
    canvas.addEventListener("dblclick", () => { view = null; redraw(); });
    canvas.addEventListener("wheel", (event) => {  // zooms time about the pointer
      event.preventDefault();
      const [from, to] = span(), at = timeAt(chart, event), factor = Math.pow(1.2, Math.sign(event.deltaY));
      const [start, end] = whole();
      const left = Math.max(start, at - (at - from) * factor), right = Math.min(end, at + (to - at) * factor);
      view = right - left >= end - start - 1e-9 ? null : right - left > 1e-3 ? [left, right] : view;
      redraw();
    }, { passive: false });
  }

  const colorOf = (signal) => (isDark() && BRIGHT[signal.color]) || signal.color;

  /** The runs whose lines of a signal are shown. */
  const drawnOf = (signal) => tracks.filter((track) => track.shown && track.number in signal.columns);

  /** The range of the axis: of what is shown, in the time that is shown; and of limits that are not far. */
  function rangeOf(signals, from, to) {
    let low = Infinity, high = -Infinity;
    for (const signal of signals) {
      let [least, most] = [signal.low, signal.high];
      if (view) {
        least = Infinity; most = -Infinity;
        for (const { frames, number } of drawnOf(signal)) for (const frame of frames) if (frame[0] >= from && frame[0] <= to) {
          least = Math.min(least, frame[signal.columns[number]]);
          most = Math.max(most, frame[signal.columns[number]]);
        }
      }
      low = Math.min(low, least);
      high = Math.max(high, most);
    }
    if (!(low <= high)) return [0, 1];
    const floats = signals.every((signal) => signal.floats);
    if (!floats && !view) { low = Math.min(low, 0); high = Math.max(high, 0); }
    const wide = high - low, reach = 0.6 * Math.max(wide, 1e-12);
    for (const signal of signals) for (const limit of signal.limits || []) {  // one that the signal comes near to
      if (limit === null || !(limit > 0 ? signal.high > 0.6 * limit : signal.low < 0.6 * limit)) continue;
      if (limit > high && limit < high + reach) high = limit;
      if (limit < low && limit > low - reach) low = limit;
    }
    const least = Math.max(LEAST, 1e-6 * Math.abs(high));  // what varies by less is a constant, and rounding
    const margin = Math.max(0.06 * (high - low), 0.5 * (least - (high - low)));
    return [low - margin, high + margin];
  }

  let now = null;
  function redraw() { if (now !== null) draw(now); }

  function draw(time) {
    now = time;
    if (!box.clientWidth) return;
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink"), grid = style.getPropertyValue("--line"), soft = style.getPropertyValue("--soft");
    const at = tracks.map((track) => (hover === null ? track.now : track.at(hover)));
    const [from, to] = span();
    for (const chart of charts) {
      const shown = chart.rows.map((entry) => entry.signal).filter((signal) => signal.shown);
      for (const entry of chart.rows) {
        entry.mark.style.background = colorOf(entry.signal);
        entry.row.classList.toggle("off", !entry.signal.shown);
        entry.row.setAttribute("aria-pressed", String(entry.signal.shown));
        entry.numbers.forEach((place, k) => {
          const value = k in entry.signal.columns ? at[k][entry.signal.columns[k]] : null;
          const brief = several || chart.rows.length > 3;
          place.textContent = value === null ? "–" : brief ? short(value) : readable(value) + " " + entry.signal.unit;
        });
      }
      const [pen, width] = cleared(chart.canvas, () => HEIGHT), [low, high] = rangeOf(shown, from, to);
      const x = (t) => LEFT + ((t - from) / (to - from)) * (width - LEFT - RIGHT);
      const y = (v) => HEIGHT - BOTTOM - ((v - low) / (high - low)) * (HEIGHT - TOP - BOTTOM);
      const stroke = (x0, y0, x1, y1) => { pen.beginPath(); pen.moveTo(x0, y0); pen.lineTo(x1, y1); pen.stroke(); };
      pen.font = "10px system-ui, sans-serif";
      pen.lineWidth = 1;
      pen.strokeStyle = grid;
      pen.fillStyle = soft;
      pen.textAlign = "right";
      pen.textBaseline = "middle";
      const up = ticksOf(low, high, 4);
      for (const value of up.ticks) {
        stroke(LEFT, y(value), width - RIGHT, y(value));
        pen.fillText(tickText(value, up), LEFT - 4, y(value));
      }
      pen.textBaseline = "top";
      pen.textAlign = "center";
      const across = ticksOf(from, to, Math.max(2, Math.floor((width - LEFT) / 70)));
      for (const value of across.ticks) {
        stroke(x(value), HEIGHT - BOTTOM, x(value), HEIGHT - BOTTOM + 3);
        pen.fillText(tickText(value, across) + (value === across.ticks[across.ticks.length - 1] ? " s" : ""),
                     Math.min(x(value), width - 14), HEIGHT - BOTTOM + 5);
      }
      pen.save();
      pen.beginPath();
      pen.rect(LEFT, 0, width - LEFT - RIGHT, HEIGHT - BOTTOM);
      pen.clip();
      drawLimits(pen, shown, low, high, y, width);
      for (const signal of shown) for (const { frames, number, index, now: frame, dash, end: last } of drawnOf(signal)) {
        const column = signal.columns[number], step = Math.max(1, Math.floor(frames.length / (2 * width)));
        pen.strokeStyle = colorOf(signal);
        pen.setLineDash(dash);
        for (const [begin, end, alpha] of [[index, frames.length - 1, several ? 0.45 : 0.3], [0, index, 1]]) {
          pen.globalAlpha = alpha;
          pen.lineWidth = 1.5;
          pen.beginPath();
          for (let i = begin; i <= end; i += step) pen.lineTo(x(frames[i][0]), y(frames[i][column]));
          if (alpha === 1) pen.lineTo(x(Math.min(time, last)), y(frame[column]));
          else pen.lineTo(x(frames[end][0]), y(frames[end][column]));
          pen.stroke();
        }
        pen.setLineDash([]);
        pen.globalAlpha = 1;
      }
      pen.strokeStyle = ink;
      pen.lineWidth = 1;
      stroke(x(time), TOP, x(time), HEIGHT - BOTTOM);
      if (hover !== null) {
        pen.setLineDash([3, 3]);
        stroke(x(hover), TOP, x(hover), HEIGHT - BOTTOM);
        pen.setLineDash([]);
      }
      pen.restore();
    }
  }

  /** The joints' limits as dashed lines, and what lies beyond them shaded. */
  function drawLimits(pen, shown, low, high, y, width) {
    for (const signal of shown) if (signal.limits) {
      signal.limits.forEach((limit, side) => {
        if (limit === null || limit < low || limit > high) return;
        if (!(limit > 0 ? signal.high > 0.6 * limit : signal.low < 0.6 * limit)) return;
        pen.fillStyle = pen.strokeStyle = colorOf(signal);
        pen.globalAlpha = 0.08;
        const edge = side === 0 ? y(low) : y(high);
        pen.fillRect(0, Math.min(y(limit), edge), width, Math.abs(edge - y(limit)));
        pen.globalAlpha = 0.7;
        pen.setLineDash([5, 4]);
        pen.beginPath();
        pen.moveTo(0, y(limit));
        pen.lineTo(width, y(limit));
        pen.stroke();
        pen.setLineDash([]);
        pen.globalAlpha = 1;
      });
    }
  }

  if (several) {
    const keys = document.getElementById("runs");
    keys.hidden = false;
    for (const track of tracks) {
      const key = make("button", { type: "button", className: "run", title: "show or hide the lines of " + track.name },
        dashOf(track), make("span", { textContent: track.name }));
      key.setAttribute("aria-pressed", "true");
      key.addEventListener("click", () => {
        track.shown = !track.shown;
        key.setAttribute("aria-pressed", String(track.shown));
        redraw();
      });
      keys.append(key);
    }
  }
  first.filter((name) => groups[name]).forEach(add);
  return {
    note, draw, redraw, groups: Object.keys(groups),
    add() {  // the next group that no chart shows yet
      const shown = charts.map((chart) => chart.group);
      add(Object.keys(groups).find((name) => !shown.includes(name)) || Object.keys(groups)[0]);
      redraw();
    },
    show(names) { charts.splice(0).forEach((chart) => chart.box.remove()); names.forEach(add); redraw(); },
  };
}
