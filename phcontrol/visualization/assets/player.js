// Plays the frames of a run in a scene, with its signals beside it.
//
// A frame is a row of numbers: time, seven for the pose of each node, six for each arrow (origin and vector),
// one for each signal, three for the point that leaves a trail. Recorded frames are in the page; live ones come
// over a socket, and stay, so that a run can be played again when it has ended.
"use strict";

const element = (id) => document.getElementById(id);

async function unpacked(id) {
  const bytes = Uint8Array.from(atob(element(id).textContent), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

async function begin() {
  if (element("meshcat")) {
    const script = document.createElement("script");
    script.textContent = await unpacked("meshcat");
    document.head.append(script);
  }
  startPlayer(JSON.parse(await unpacked("run")));
}

function startPlayer(run) {
  const columns = { nodes: 1 };
  columns.arrows = columns.nodes + 7 * run.nodes.length;
  columns.signals = columns.arrows + 6 * run.arrows.length;
  columns.trail = columns.signals + run.signals.length;
  columns.image = columns.trail + 3;
  columns.count = columns.image + (run.image ? run.image.columns : 0);

  const frames = [];
  let time = 0, playing = false, following = run.live, drawn = -1;

  const scheme = window.matchMedia("(prefers-color-scheme: dark)"), isDark = () => scheme.matches;
  const scene = makeScene(run, columns, element("meshcat-pane"), isDark);
  const first = ["storage function", "joint error", "torque"];
  if (run.signals.some((signal) => signal.group === "contact")) first.splice(1, 1, "contact");
  if (!run.signals.some((signal) => signal.group === first[1])) first.splice(1, 1, "position");
  const charts = makeCharts(run, columns, frames, element("charts"), { seek, isDark, first, });
  element("add").addEventListener("click", charts.add);

  // --- one moment -----------------------------------------------------------------------------------------

  function indexAt(moment) {
    let low = 0, high = frames.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (frames[middle][0] <= moment) low = middle; else high = middle - 1;
    }
    return low;
  }

  function frameAt(moment, into) {
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

  const shown = new Float64Array(columns.count), hovered = new Float64Array(columns.count);

  function show(moment) {
    if (frames.length === 0) return;
    const start = frames[0][0], end = frames[frames.length - 1][0];
    time = Math.min(Math.max(moment, start), end);
    const index = frameAt(time, shown);
    scene.show(frames, index, shown);
    if (!document.body.classList.contains("folded")) {
      charts.draw(index, shown, time, (at) => { frameAt(at, hovered); return hovered; });
      if (run.image) drawImage(run, columns, frames, index, shown, element("image"));
    }
    element("arrows").textContent = [...new Set(run.arrows.map((arrow) => arrow.unit))]
      .map((unit) => "arrows: 1 " + unit + " is " + readable(1000 * scene.scaleOf(unit)) + " mm").join("; ");
    element("clock").textContent = time.toFixed(2) + " s of " + end.toFixed(2);
    const scrub = element("scrub");
    scrub.min = start;
    scrub.max = Math.max(end, start + 1e-6);
    scrub.value = time;
    scrub.setAttribute("aria-valuetext", time.toFixed(2) + " seconds");
    drawn = frames.length;
  }

  // --- playing --------------------------------------------------------------------------------------------

  let last = null;
  function tick(now) {
    if (following) {
      if (frames.length !== drawn && frames.length) show(frames[frames.length - 1][0]);
    } else if (playing && frames.length) {
      const passed = last === null ? 0 : (now - last) / 1000;
      const end = frames[frames.length - 1][0];
      show(time + passed * Number(element("speed").value));
      if (time >= end) setPlaying(false);
    }
    last = now;
    window.requestAnimationFrame(tick);
  }

  function setPlaying(on) {
    playing = on;
    element("play").textContent = on ? "❚❚" : "▶";
    element("play").setAttribute("aria-label", on ? "pause" : "play");
  }

  function setFollowing(on) {
    following = on;
    element("live").classList.toggle("on", on);
  }

  function play() {
    setFollowing(false);
    if (frames.length && time >= frames[frames.length - 1][0]) show(frames[0][0]);
    setPlaying(true);
  }

  function seek(moment) {
    setFollowing(false);
    setPlaying(false);
    show(moment);
  }

  function take(rows) {
    for (let at = 0; at + columns.count <= rows.length; at += columns.count) {
      const frame = rows.subarray(at, at + columns.count);
      if (frames.length && frame[0] <= frames[frames.length - 1][0]) continue;
      frames.push(frame);
      scene.noteForces(frame);
      charts.note(frame);
    }
  }

  // --- the page -------------------------------------------------------------------------------------------

  function fold(on) {
    document.body.classList.toggle("folded", on);
    element("fold").setAttribute("aria-expanded", String(!on));
    element("fold").textContent = on ? "show charts" : "hide charts";
    scene.fit();
    show(time);
  }

  let axes = true;
  function showAxes(on) {
    axes = on;
    element("axes").setAttribute("aria-pressed", String(on));
    scene.showFrames(on);
  }

  element("play").addEventListener("click", () => (playing ? setPlaying(false) : play()));
  element("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
  element("live").addEventListener("click", () => { setPlaying(false); setFollowing(true); drawn = -1; });
  element("fold").addEventListener("click", () => fold(!document.body.classList.contains("folded")));
  element("axes").addEventListener("click", () => showAxes(!axes));
  scheme.addEventListener("change", () => { scene.lookAtScene(); show(time); });
  new ResizeObserver(() => { scene.fit(); show(time); }).observe(element("meshcat-pane"));
  window.addEventListener("keydown", (event) => {
    const typing = ["INPUT", "SELECT", "BUTTON", "TEXTAREA"].includes(event.target.tagName);
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    const actions = {
      " ": () => (playing ? setPlaying(false) : play()),
      ArrowRight: () => seek(time + 0.1),
      ArrowLeft: () => seek(time - 0.1),
      Home: () => seek(frames[0][0]),
      End: () => seek(frames[frames.length - 1][0]),
      c: () => fold(!document.body.classList.contains("folded")),
      f: () => showAxes(!axes),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  });

  element("title").textContent = run.title;
  if (run.certificate) {
    element("badge").hidden = false;
    element("badge").classList.toggle("failed", !run.certificate.passed);
    element("badge").querySelector("summary").textContent = "certificate: " + run.certificate.verdict;
    element("badge").querySelector("pre").textContent = run.certificate.text;
  }
  if (run.notes.length) {
    element("notes").hidden = false;
    element("notes").querySelector("summary").textContent = run.notes.length + " note" + (run.notes.length > 1 ? "s" : "");
    for (const note of run.notes) {
      const item = document.createElement("li");
      item.textContent = note;
      element("notes").querySelector("ul").append(item);
    }
  }

  // --- live -----------------------------------------------------------------------------------------------

  let socket = null, handleAt = () => [0, 0];

  function listen() {
    element("live").hidden = false;
    setFollowing(true);
    socket = new WebSocket((location.protocol === "https:" ? "wss://" : "ws://") + location.host + "/frames");
    socket.binaryType = "arraybuffer";
    socket.onmessage = (message) => {
      if (typeof message.data === "string") ended(); else take(new Float32Array(message.data));
    };
    socket.onclose = ended;
  }

  function ended() {
    element("live").hidden = true;
    element("controls").hidden = true;
    if (following && frames.length) show(frames[frames.length - 1][0]);
    setFollowing(false);
    api.ended = true;
  }

  if (run.controls) {
    handleAt = makeControls(run, scene, element("controls"), (part, values) => {
      if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ part, values }));
    });
  }

  const { viewer, THREE } = scene;
  const api = window.phcontrol = {
    run, viewer, charts, play, seek, fold,
    pause: () => setPlaying(false),
    ended: false,
    handle: (part) => handleAt(part),
    get time() { return time; },
    get frames() { return frames.length; },
    get duration() { return frames.length ? frames[frames.length - 1][0] : 0; },
    /** Where a node of the scene is, in the world: [x, y, z]. */
    where(path) {
      const object = viewer.scene_tree.find(path.split("/")).object, root = viewer.scene_tree.object;
      root.updateMatrixWorld(true);
      return root.worldToLocal(object.getWorldPosition(new THREE.Vector3())).toArray();  // z up, not three.js's y
    },
  };

  window.requestAnimationFrame(() => window.requestAnimationFrame(scene.fit));  // after MeshCat's own first fit
  scene.lookAtScene();
  if (run.frames) take(framesOf(run.frames, columns.count));
  if (run.live) listen(); else { show(0); play(); }
  window.requestAnimationFrame(tick);
}

begin().catch((error) => {
  element("title").textContent = "this page needs a newer browser: " + error.message;
  throw error;
});
