// One run of those on the page: what it is, its frames so far, and what it is like at any time.
"use strict";

const DASHES = [[], [7, 3], [2, 3], [9, 3, 2, 3]];  // of its lines where runs lie over each other

/** A frame is a row: time, seven for each node's pose, six for each arrow, one for each signal, the trail, the image. */
function makeTrack(run, number) {
  const columns = { nodes: 1 };
  columns.arrows = columns.nodes + 7 * run.nodes.length;
  columns.signals = columns.arrows + 6 * run.arrows.length;
  columns.trail = columns.signals + run.signals.length;
  columns.image = columns.trail + 3;
  columns.count = columns.image + (run.image ? run.image.columns : 0);
  const frames = [], now = new Float64Array(columns.count), elsewhere = new Float64Array(columns.count);

  function indexAt(moment) {
    let low = 0, high = frames.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (frames[middle][0] <= moment) low = middle; else high = middle - 1;
    }
    return low;
  }

  /** Fills a frame with what is at a moment, before the first and after the last what is there; returns its index. */
  function fill(into, moment) {
    const i = indexAt(moment), before = frames[i], after = frames[Math.min(i + 1, frames.length - 1)];
    const gap = after[0] - before[0];
    const part = gap > 0 ? Math.min(1, Math.max(0, (moment - before[0]) / gap)) : 0;
    for (let c = 0; c < columns.count; c++) into[c] = before[c] + part * (after[c] - before[c]);
    for (let n = 0; n < run.nodes.length; n++) {  // quaternions: the short way, made unit again
      const at = columns.nodes + 7 * n + 3;
      let dot = 0, norm = 0;
      for (let c = at; c < at + 4; c++) dot += before[c] * after[c];
      for (let c = at; c < at + 4; c++) {
        into[c] = before[c] + part * ((dot < 0 ? -after[c] : after[c]) - before[c]);
        norm += into[c] * into[c];
      }
      for (let c = at; c < at + 4; c++) into[c] /= Math.sqrt(norm);
    }
    return i;
  }

  return {
    run, number, columns, frames, now, index: 0, shown: true, dash: DASHES[number % DASHES.length],
    name: run.name,
    get start() { return frames[0][0]; },
    get end() { return frames[frames.length - 1][0]; },
    /** Makes ``now`` the frame at a moment. */
    goTo(moment) { this.index = fill(now, moment); },
    /** The frame at another moment. */
    at(moment) { fill(elsewhere, moment); return elsewhere; },
  };
}

/** A piece of a run's line, as its mark: the name of the run is its title. */
function dashOf(track) {
  const mark = document.createElement("span");
  mark.className = "dash";
  mark.title = track.name;
  mark.innerHTML = '<svg width="26" height="8" aria-hidden="true"><line x1="0" y1="4" x2="26" y2="4" stroke="currentColor" ' +
    'stroke-width="2" stroke-dasharray="' + track.dash.join(" ") + '"/></svg>';
  return mark;
}
